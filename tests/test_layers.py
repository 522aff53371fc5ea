"""Imports run one way: capture -> methods -> integration -> export; the stages meet in `types`, never each other."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "photonormal"
BASE = {
    "types",
    "geometry",
    "shading",
    "disk",
    "files",
    "options",
    "stored",
    "png",
    "masked",
    "resources",
    "curl",
    "outline",
    "horizon",
    "lookup",
    "srgb",
    "arrays",
    "notebook",
    "crop",
    "lighting",
}
MAY_IMPORT = {  # package or module -> what of photonormal it may import besides itself
    "png": set(),
    "masked": set(),
    "arrays": {"errors"},
    "notebook": {"png"},
    "errors": set(),
    "lamps": {"errors"},
    "lazy": set(),
    "types": {"errors", "lamps", "lazy", "masked", "arrays", "notebook", "resources", "crop"},
    "crop": {"errors", "lamps", "options"},
    "lighting": {"types"},
    "files": {"types", "png"},
    "geometry": {"types"},
    "curl": set(),
    "outline": set(),
    "horizon": set(),
    "lookup": set(),
    "srgb": set(),
    "shading": set(),
    "disk": {"types"},
    "options": {"errors"},
    "stored": {"types", "files"},
    "progress": set(),
    "resources": set(),
    "provenance": {"types", "files", "methods", "stored", "options"},
    "capture": BASE,
    "calibration": BASE,
    "methods": BASE | {"integration", "calibration", "progress"},  # near lamps need depth; intensities are told apart
    "integration": BASE,
    "scoring": BASE,
    "export": BASE | {"scoring"},  # maps of errors
    "synth": BASE | {"capture", "progress"},
    "train": BASE | {"capture", "methods", "scoring", "synth", "progress"},
    "doctor": BASE | {"calibration"},
    "examination": BASE | {"doctor", "methods", "progress"},
    "rig": BASE | {"capture", "calibration", "doctor", "examination", "export", "methods", "progress"},
    "lamp_choice": BASE | {"capture", "export", "methods", "synth", "progress"},
    "object_lights": BASE | {"capture", "export", "methods", "progress"},
    "measurement": BASE
    | {"capture", "methods", "materials", "integration", "scoring", "progress", "doctor", "examination"},
    "job": BASE | {"capture", "methods", "measurement", "export", "rig", "provenance"},
    "batch": BASE | {"capture", "job", "export", "provenance", "progress", "view"},
    "view": BASE | {"capture", "calibration", "scoring", "export", "progress", "rig"},
    "relighting": BASE | {"methods", "progress"},  # the memory's plan
    "materials": BASE | {"methods", "progress"},  # the memory's plan
    "handover": BASE | {"capture", "export", "methods", "relighting", "view", "progress", "integration"},
    "bench": BASE
    | {"capture", "measurement", "methods", "integration", "scoring", "export", "progress", "view"}
    | {"provenance", "batch"},
}


def imported(file: Path) -> set[str]:
    """Second parts of the photonormal modules that a file imports, wherever the import stands."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "photonormal":
            parts = node.module.split(".")
            names |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            parts = [alias.name.split(".") for alias in node.names]
            names |= {p[1] if len(p) > 1 else "__init__" for p in parts if p[0] == "photonormal"}
    return names


def test_the_walk_sees_imports():
    assert "types" in imported(SOURCE / "methods" / "engine" / "samples.py")


@pytest.mark.parametrize("place", MAY_IMPORT)
def test_imports_run_with_the_arrows(place):
    files = sorted((SOURCE / place).rglob("*.py")) or [p for p in [SOURCE / f"{place}.py"] if p.exists()]
    for file in files:
        against = imported(file) - MAY_IMPORT[place] - {place, "__init__", "__version__"}
        assert not against, f"{file.relative_to(SOURCE)} imports {against}"


def test_only_the_command_line_imports_the_command_line():
    for file in SOURCE.rglob("*.py"):
        if "cli" not in file.relative_to(SOURCE).parts and file.name != "__main__.py":
            above = {"cli"} if "bench" in file.relative_to(SOURCE).parts else {"cli", "bench"}
            assert not imported(file) & above, file


TWINS = {"angle_deg", "normalised"}  # the same of NumPy's arrays and of torch's
FRONT_DOORS = {"bench", "train"}  # which load what they stand for when they are called


def test_a_name_means_one_thing():
    """Classes, but those of commands, and functions that other modules import by their names."""
    classes, functions, asked = defaultdict(set), defaultdict(set), set()
    for path in SOURCE.rglob("*.py"):
        tree, module = ast.parse(path.read_text()), _name(path)
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not module.startswith("photonormal.cli."):
                classes[node.name].add(module)
            if isinstance(node, ast.FunctionDef):
                functions[node.name].add(module)
        asked |= {(f.module, a.name) for f in ast.walk(tree) if isinstance(f, ast.ImportFrom) for a in f.names}
    assert not {name: where for name, where in classes.items() if len(where) > 1}
    both = {name: {m for m in where if (m, name) in asked} for name, where in functions.items()}
    assert not {name: m for name, m in both.items() if len(m) > 1 and name not in TWINS | FRONT_DOORS}


def _name(path: Path) -> str:
    return ".".join(("photonormal", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__")
