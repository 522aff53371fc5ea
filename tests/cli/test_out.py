"""The photographs' own folder as the place of the results, however it is named: nothing of the user's is ever lost."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from photonormal import cli
from tests.capture.files import LIGHTS, write_picture
from tests.fuzz.drive import digests

REFUSED, BESIDE = 2, 0


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A folder of the user's with photographs and other things in it, which the command runs in."""
    capture = tmp_path / "home" / "photos"
    for j, light in enumerate(LIGHTS):
        picture = np.full((8, 8, 3), 60 + 40 * light[2] + 5 * j + 3 * np.arange(8)[:, None, None], np.uint8)
        write_picture(capture / f"{j + 1}.png", picture)
    np.savetxt(capture / "light_directions.txt", LIGHTS)
    for name in ("letter.txt", "photos/notes.txt", "photos/raw/1.dng", "photos/normals.png.old", ".hidden"):
        (tmp_path / "home" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "home" / name).write_text(f"mine: {name}")
    (tmp_path / "link").symlink_to(capture)
    monkeypatch.chdir(capture)
    return tmp_path / "home"


def bind(home):
    """A bind mount of the photographs' folder."""
    place = home.parent / "mounted"
    place.mkdir()
    if subprocess.run(["mount", "--bind", home / "photos", place], capture_output=True).returncode:
        pytest.skip("only root mounts, and not everywhere")
    return place


def earlier_result(home):
    """The photographs lie in a folder that is a result of photonormal's, too."""
    for name in ("notes.txt", "normals.png.old"):
        (home / "photos" / name).unlink()
    pictures = {p: p.read_bytes() for p in (home / "photos").glob("*.png")}
    for path in pictures:
        path.rename(home / path.name)
    assert cli.main(["measure", "demo", "--images", "1-4", "--out", ".", "--overwrite", "--method", "woodham"]) == 0
    for path, data in pictures.items():
        path.write_bytes(data)
    return "."


WAYS = {
    ".": (lambda home: ".", REFUSED),
    "empty": (lambda home: "", REFUSED),
    "absolute": (lambda home: str(home / "photos"), REFUSED),
    "relative": (lambda home: "../photos", REFUSED),
    "up and down": (lambda home: "raw/../../photos/.", REFUSED),
    "with a slash": (lambda home: f"{home}/photos/", REFUSED),
    "a link": (lambda home: str(home.parent / "link"), REFUSED),
    "a bind mount": (bind, REFUSED),
    "an earlier result": (earlier_result, REFUSED),
    "its parent": (lambda home: "..", BESIDE),
    "below it": (lambda home: "result", BESIDE),
    "beside its RAW files": (lambda home: "raw", BESIDE),
}


@pytest.mark.parametrize("command", ["measure", "check"])
@pytest.mark.parametrize("way", WAYS)
def test_the_photographs_own_folder(home, capsys, way, command):
    place, expected = WAYS[way]
    out = place(home)
    how = ["--method", "woodham", "--no-mesh"] if command == "measure" else []
    try:
        before = digests(home)
        for overwrite in ([], ["--overwrite"], ["--overwrite"]):
            capsys.readouterr()
            code = cli.main([command, ".", "--out", str(out), *how, *overwrite])
            said = capsys.readouterr().err.splitlines()
            assert code == (expected if overwrite or way == "below it" else REFUSED), said
            assert code == 0 or (len(said) == 1 and said[0].startswith("photonormal: ")), said
            after = digests(home)
            assert {name: after.get(name) for name in before} == before
            assert code == 0 or after == before
        if expected == BESIDE:
            assert (Path(out) / "report.json").is_file()
    finally:
        if way == "a bind mount":
            subprocess.run(["umount", out], check=True)
    assert not [name for name in os.listdir(home / "photos") if "partial" in name]


@pytest.mark.parametrize("words", ["integrate normals.png --out mesh.ply", "convert ../mine.png --out normals.png"])
def test_maps_are_not_written_over_files_of_a_result(tmp_path, monkeypatch, capsys, words):
    """Neither with --overwrite, nor where the map that is read is none of that result."""
    monkeypatch.chdir(tmp_path)
    assert cli.main(["measure", "demo", "--images", "1-4", "--out", "r", "--method", "woodham"]) == 0
    shutil.copy(tmp_path / "r" / "normals.png", tmp_path / "mine.png")
    before = digests(tmp_path)
    monkeypatch.chdir(tmp_path / "r")
    assert cli.main([*words.split(), "--overwrite"]) == REFUSED
    assert "belongs to a result and is not written over" in capsys.readouterr().err
    assert cli.main(["convert", "../mine.png", "--out", "../mine.png", "--overwrite"]) == REFUSED
    assert "mine.png is read here and is not written over" in capsys.readouterr().err
    assert digests(tmp_path) == before
