import json
import os
import signal
import subprocess
import sys

import pytest

from photonormal.disk import PARTIAL
from photonormal.export import encoded, load_normals
from photonormal.export.folder import report, whole_folder
from photonormal.types import InputError
from tests.scenes import sphere


def result(out, names=("normals.png", "mesh.ply"), text="new", **how):
    """Write a small result."""
    with whole_folder(out, **how) as batch:
        for name in names:
            batch.write(name, f"{name}, {text}".encode())
        return report(batch, {"text": text})


def content(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_report_lists_the_files_of_its_result(tmp_path):
    told = result(tmp_path / "deep" / "out")
    assert told == json.loads((tmp_path / "deep" / "out" / "report.json").read_text())
    assert told["files"] == {"normals.png": 16, "mesh.ply": 13}
    assert sorted(content(tmp_path)) == ["deep/out/mesh.ply", "deep/out/normals.png", "deep/out/report.json"]


def test_nothing_is_left_when_the_block_fails(tmp_path):
    with pytest.raises(RuntimeError), whole_folder(tmp_path / "deep" / "out") as batch:
        batch.write("normals.png", b"half")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_the_result_before_as_it_was(tmp_path):
    result(tmp_path, text="first")
    before = content(tmp_path)
    with pytest.raises(RuntimeError), whole_folder(tmp_path) as batch:
        batch.write("normals.png", b"half")
        raise RuntimeError
    assert content(tmp_path) == before


def test_the_files_of_the_result_before_go_and_nothing_else_does(tmp_path):
    result(tmp_path, text="first")
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "private").mkdir()
    (tmp_path / "private" / "letter.txt").write_text("mine")
    (tmp_path / "error.png").write_text("mine, though of a name of a result")
    kept = {p: p.stat().st_ino for p in tmp_path.rglob("*") if p.name in ("notes.txt", "private", "error.png")}
    result(tmp_path, ["normals.png"], overwrite=True)
    assert not (tmp_path / "mesh.ply").exists()
    assert (tmp_path / "normals.png").read_text() == "normals.png, new"
    assert all(p.stat().st_ino == inode for p, inode in kept.items())
    assert (tmp_path / "private" / "letter.txt").read_text() == "mine"


def test_a_file_that_has_changed_since_is_no_longer_ours(tmp_path):
    result(tmp_path, text="first")
    (tmp_path / "mesh.ply").write_text("repaired by hand")
    with pytest.raises(InputError, match=r"mesh\.ply was not written by photonormal, or has changed since"):
        result(tmp_path)
    result(tmp_path, ["normals.png"], overwrite=True)
    assert (tmp_path / "mesh.ply").read_text() == "repaired by hand"


@pytest.mark.parametrize(
    "told",
    [
        *("no json", "[]", "{}", '{"photonormal": "0.1.0"}', '{"written_by": "photonormal"}', "[" * 100000),
        '{"written_by": "photonormal", "files": ["thesis.txt"]}',
    ],
)
def test_a_report_without_marker_and_files_is_not_ours(tmp_path, told):
    (tmp_path / "report.json").write_text(told)
    with pytest.raises(InputError, match="--overwrite"):
        result(tmp_path)
    assert (tmp_path / "report.json").read_text() == told


def test_a_report_cannot_make_other_files_ours(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "normals.npz").write_text("mine")
    (out / "thesis.txt").write_text("mine")
    files = {"thesis.txt": 4, "../normals.npz": 4, str(tmp_path / "normals.npz"): 4, "mesh.ply": [], "error.png": 4}
    (out / "report.json").write_text(json.dumps({"written_by": "photonormal", "files": files}))
    result(out, ["normals.png"])
    assert (out / "thesis.txt").read_text() == (tmp_path / "normals.npz").read_text() == "mine"


def test_a_folder_with_other_things_needs_overwrite(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    (tmp_path / "normals.png").write_text("mine")
    before = content(tmp_path)
    with pytest.raises(InputError, match="--overwrite"):
        result(tmp_path)
    assert content(tmp_path) == before
    result(tmp_path, overwrite=True)
    assert sorted(content(tmp_path)) == ["mesh.ply", "normals.png", "report.json", "thesis.txt"]


def test_what_is_read_is_never_written_over(tmp_path):
    capture = tmp_path / "capture"
    (capture / "out").mkdir(parents=True)
    for name in ("normals.png", "out/normals.png"):
        (capture / name).write_text("true normals")
    with pytest.raises(InputError, match="holds the photographs"):
        result(capture, overwrite=True, reads=[capture])
    with pytest.raises(InputError, match="among the files that are read"):
        result(capture / "out", overwrite=True, reads=[capture])
    (tmp_path / "link").symlink_to(capture / "out" / "normals.png")
    with pytest.raises(InputError, match="among the files that are read"):
        result(capture / "out", overwrite=True, reads=[tmp_path / "link"])
    result(capture / "new", reads=[capture])
    result(capture / "new", reads=[capture])  # its own results may be replaced
    with pytest.raises(InputError, match="among the files that are read"):
        result(capture / "new", reads=[capture, capture / "new" / "mesh.ply"])


def test_a_folder_of_the_name_of_a_result_stays(tmp_path):
    (tmp_path / "normals.png").mkdir()
    (tmp_path / "normals.png" / "letter.txt").write_text("mine")
    with pytest.raises(InputError, match=r"normals\.png is a folder"):
        result(tmp_path, overwrite=True)
    assert sorted(content(tmp_path)) == ["normals.png/letter.txt"]


def test_places_that_are_no_folders_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "nowhere").symlink_to("absent")
    os.mkfifo(tmp_path / "pipe")
    for out, says in {
        "file": "is a file",
        "file/below": "its folder is a file",
        "nowhere": "link to nothing",
        "pipe": "is a file",
        "a" * 300: "too long",
        "": "--overwrite",
        "..": "--overwrite",
    }.items():
        with pytest.raises(InputError, match=says):
            result(tmp_path / out if out in ("..",) else type(tmp_path)(out))
    assert sorted(os.listdir(tmp_path)) == ["file", "nowhere", "pipe"]


def test_a_link_to_a_folder_is_followed_and_kept(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to("disk")
    for _ in range(2):
        result(tmp_path / "link")
        assert (tmp_path / "link").is_symlink() and (tmp_path / "disk" / "mesh.ply").is_file()


def test_the_working_folder_can_hold_the_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result(type(tmp_path)(""))
    assert sorted(content(tmp_path)) == ["mesh.ply", "normals.png", "report.json"]


def test_a_file_that_appears_meanwhile_is_not_written_over(tmp_path):
    with pytest.raises(InputError, match="was not written by photonormal"), whole_folder(tmp_path) as batch:
        batch.write("normals.png", b"new")
        (tmp_path / "normals.png").write_text("mine")
    assert content(tmp_path) == {"normals.png": b"mine"}


def test_names_that_are_no_utf8_can_be_read_back(tmp_path):
    name = os.fsdecode(b"caf\xe9.png")
    with whole_folder(tmp_path) as batch:
        report(batch, {"images": [name, "\u00fc"]})
    assert json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["images"] == [name, "\u00fc"]


def test_a_full_disk_is_one_line(tmp_path):
    with pytest.raises(InputError, match="no space is left") as caught, whole_folder(tmp_path / "out"):
        raise OSError(28, "No space left on device")
    assert "\n" not in str(caught.value) and not (tmp_path / "out").exists()


def test_a_name_of_ours_that_is_taken_is_refused(tmp_path):
    (tmp_path / PARTIAL).mkdir()
    (tmp_path / PARTIAL / "letter.txt").write_text("mine")
    with pytest.raises(InputError, match="needs that name"):
        result(tmp_path, overwrite=True)
    assert (tmp_path / PARTIAL / "letter.txt").read_text() == "mine"


KILLED = """
import os, sys
from pathlib import Path
from photonormal.export.folder import report, whole_folder
rename, left = os.rename, [int(sys.argv[2])]
def killed(*paths):
    left[0] -= 1
    os.kill(os.getpid(), 9) if left[0] == 0 else rename(*paths)
os.rename = killed
with whole_folder(Path(sys.argv[1])) as batch:
    batch.write("normals.npz", b"new")
    report(batch, {})
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no such end")
@pytest.mark.parametrize("rename", [2, 3])
def test_a_result_that_a_kill_left_among_its_moves_is_whole_when_it_is_read(tmp_path, caplog, rename):
    normals = sphere(8)
    with whole_folder(tmp_path) as batch:
        batch.write("normals.npz", encoded(normals, "normals.npz"))
        report(batch, {})
    assert subprocess.run([sys.executable, "-c", KILLED, tmp_path, str(rename)]).returncode == -signal.SIGKILL
    assert not (tmp_path / "report.json").exists() or not (tmp_path / "normals.npz").exists()
    assert (load_normals(tmp_path).map == normals.map).all()
    assert "the files that it was replacing are back" in caplog.text
    assert sorted(os.listdir(tmp_path)) == ["normals.npz", "report.json"]
