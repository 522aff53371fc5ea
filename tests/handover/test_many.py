"""Several results, and those of a batch, handed on at a time."""

import json
import shutil

import pytest

from photonormal.cli import main
from photonormal.export.folder import MARKER


@pytest.fixture
def batch(measured, tmp_path):
    """A folder as `batch` leaves it, with two results and one that failed."""
    folder = tmp_path / "results"
    for name in ("vase 1", "2/front"):
        shutil.copytree(measured / "r", folder / name)
    (folder / "gone").mkdir()
    for place in (folder, folder / "gone"):
        (place / "report.json").write_text(json.dumps(MARKER | {"files": {}}))
    return folder


def export(*words):
    return main(["export", *map(str, words)])


def files(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_each_result_of_a_batch_is_written_under_its_name(batch, measured, tmp_path, capsys):
    assert export(batch, "--to", "ptm", "--out", tmp_path / "ptm") == 0
    assert files(tmp_path / "ptm") == ["2/front.ptm", "vase 1.ptm"]
    out, err = capsys.readouterr()
    assert out.count("\n") == 2 and err == "photonormal: left out, since they have no result: gone\n"
    assert export(measured / "r", "--to", "ptm", "--out", tmp_path / "one.ptm") == 0
    assert (tmp_path / "one.ptm").read_bytes() == (tmp_path / "ptm" / "vase 1.ptm").read_bytes()
    assert export(batch / "vase 1", batch / "2", "--relit", "45,50", "--out", tmp_path / "lit") == 0
    assert files(tmp_path / "lit") == ["front.png", "vase 1.png"]
    assert export(batch, "--to", "maps", "--out", tmp_path / "maps") == 0
    assert "vase 1/vase 1_Normal.png" in files(tmp_path / "maps")


def test_what_cannot_be_written_of_one_is_told_and_the_others_go_on(batch, tmp_path, capsys):
    (batch / "2" / "front" / "albedo.png").unlink()
    assert export(batch, "--to", "gltf", "--out", tmp_path / "glb") == 1
    assert files(tmp_path / "glb") == ["vase 1.glb"]
    assert "photonormal: 2/front: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--page", "p.html"), "a page is one result's"),
        (("--to", "ptm", "--out", "x", "--capture", "y"), "a folder of photographs is one result's"),
        (("--to", "ptn", "--out", "x"), "perhaps ptm is meant"),
        (("--to", "ptm", "--out", "x.ptm"), "x.ptm is called like one file"),
    ],
)
def test_what_is_for_one_result_alone_is_refused(batch, tmp_path, monkeypatch, capsys, words, says):
    monkeypatch.chdir(tmp_path)
    before = files(tmp_path)
    assert export("results/vase 1", "results/2", *words) == 2
    err = capsys.readouterr().err
    assert says in err and err.count("\n") == 1 and files(tmp_path) == before
    assert export("results/vase 1", "results/2/../vase 1", "--to", "ptm", "--out", "x") == 2
    assert "would both be called vase 1" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ("--relit", "45,30", "--by", "matt", "--out", "albedo.png"),
        ("--relit", "45,30", "--out", "preview.png"),
        ("--page", "view.html"),
    ],
)
def test_a_result_is_not_written_over(measured, tmp_path, capsys, words):
    result = shutil.copytree(measured / "r", tmp_path / "r")
    (result / "view.html").write_text("as a batch writes it")
    report = json.loads((result / "report.json").read_text())
    report["files"]["view.html"] = (result / "view.html").stat().st_size
    (result / "report.json").write_text(json.dumps(report))
    before = {p.name: p.read_bytes() for p in result.iterdir()}
    assert export(result, *words[:-1], result / words[-1], "--overwrite") == 2
    assert "belongs to a result and is not written over" in capsys.readouterr().err
    assert {p.name: p.read_bytes() for p in result.iterdir()} == before
    assert export(result, "--relit", "45,30", "--out", result / "lit.png") == 0  # beside them it may lie


def test_options_without_effect_are_refused(refused, tmp_path):
    refused("--page", tmp_path / "p.html", "--exr", says="--exr came without --to maps")
    refused("--to", "ptm", "--out", tmp_path / "x.ptm", "--by", "matt", says="--by came without --relit or --sweep")
