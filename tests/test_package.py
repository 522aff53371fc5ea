"""The front door: what a newcomer types first."""

import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import photonormal as pn

ROOT = Path(__file__).parents[1]


def test_importing_loads_none_of_the_large_libraries():
    code = "import sys, photonormal; assert not {'torch', 'cv2', 'matplotlib', 'trimesh', 'scipy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_readme_example_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert example is not None
    assert len([line for line in example[1].splitlines() if line.strip()]) <= 6
    exec(example[1], {})
    assert sorted(p.name for p in tmp_path.iterdir()) == ["demo.ply", "demo.png"]


def test_no_name_hides_a_package():
    """``import photonormal.x.y as z`` works for every module, whatever functions the package gives by their names."""
    for module in pkgutil.walk_packages(pn.__path__, "photonormal."):
        parent, name = module.name.rsplit(".", 1)
        given = getattr(importlib.import_module(parent), name, None)
        assert given is None or isinstance(given, ModuleType), module.name


def test_every_method_resolves():
    from photonormal.integration import METHODS as INTEGRATION
    from photonormal.integration import integrate
    from photonormal.methods import METHODS, method_class

    for name in METHODS:
        assert method_class(name).__dataclass_params__.frozen, name
    assert callable(integrate) and INTEGRATION


def test_the_demo_capture_is_whole():
    capture = pn.load("demo")
    assert capture.truth is not None and capture.mask.sum() > 5000
    assert capture.lights is not None and len(capture.lights) == capture.images.shape[0] >= 10
