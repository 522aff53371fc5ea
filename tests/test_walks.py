"""The walks of the docs: every command in them runs, in order, and leaves what the text says."""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from photonormal.cli import main

WALKS = Path(__file__).parents[1] / "docs" / "walks"
LEFT = {
    "tablet": ("tablet/mask.png", "tablet-result/depth.npz", "tablet-result/report.json", "tablet.html"),
    "cloth": (
        "cloth/lights.lp",
        "cloth/lights_spheres.png",
        "cloth-result/normals.png",
        "cloth-directx.png",
        "cloth.glb",
    ),
    "my-method": ("mine-result/report.json", "runs/mine/diligent/objects_0001.npz", "report.html"),
}


def scenes():
    spec = importlib.util.spec_from_file_location("scenes", WALKS / "scenes.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def commands(walk):
    blocks = re.findall(r"```sh\n(.*?)```", (WALKS / f"{walk}.md").read_text(), re.DOTALL)
    return [line for block in blocks for line in block.splitlines()]


def opened(words):
    """A page that `view` serves: its address appears, and it is ended."""
    command = [sys.executable, "-m", "photonormal", *words[1:], "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        address = process.stdout.readline()
        process.terminate()
    return address.startswith("http://127.0.0.1:")


def prepare(walk, folder):
    if walk == "tablet":
        scenes().tablet(folder / "tablet", 112)
    elif walk == "cloth":
        scenes().cloth(folder / "cloth", folder / "sphere", 112)
    else:
        (folder / "mine.py").write_text((WALKS / "mine.py").read_text())


@pytest.mark.parametrize("walk", LEFT)
def test_every_command_runs(walk, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    prepare(walk, tmp_path)
    found = commands(walk)
    assert len(found) >= 5
    for line in found:
        words = shlex.split(line)
        if words[:2] == ["photonormal", "view"]:
            pytest.importorskip("fastapi")
            assert opened(words), line
        elif words[0] == "photonormal":
            assert main(words[1:]) == 0, (line, capsys.readouterr().err)
        else:
            assert words[:2] == ["python", "mine.py"], line
            if "all" in words:  # three of the methods are enough here
                words[words.index("all")] = "mine,woodham,l1"
            subprocess.run([sys.executable, *words[1:]], check=True, env=os.environ, stdout=subprocess.DEVNULL)
    assert [name for name in LEFT[walk] if not (tmp_path / name).is_file()] == []


def test_the_method_in_the_text_is_the_file():
    blocks = re.findall(r"```python\n(.*?)```", (WALKS / "my-method.md").read_text(), re.DOTALL)
    assert blocks == [(WALKS / "mine.py").read_text()]


@pytest.mark.parametrize("walk", LEFT)
def test_its_pictures_are_there_and_small(walk):
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", (WALKS / f"{walk}.md").read_text())
    assert pictures and all((WALKS / p).stat().st_size < 300_000 for p in pictures)
