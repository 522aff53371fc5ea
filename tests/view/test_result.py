"""What a result folder gives to the page, and what is told of one that can't be shown."""

import json
import shutil

import numpy as np
import pytest

from photonormal.export import load_normals
from photonormal.files import memory
from photonormal.types import Normals
from photonormal.view.planes import LEVELS_PER_DEGREE, UNKNOWN
from photonormal.view.result import open_result, shown_of


@pytest.fixture
def copy(result, tmp_path):
    return shutil.copytree(result, tmp_path / "copy")


def test_a_result_has_all_its_layers(result):
    shown = open_result(result)
    assert set(shown.layers) == {"normals", "albedo", "height", "expected", "error"}
    assert len(shown.about["photographs"]) == 12 and shown.about["notes"] == []
    h, w = shown.about["height"], shown.about["width"]
    assert all(p.levels[0].shape[:2] == (h, w) for p in shown.layers.values())
    assert shown.photographs[3].levels[0].shape == (h, w, 3)


def test_the_true_error_is_that_of_the_report(result):
    level = open_result(result).layers["error"].levels[0]
    mean = level[level != UNKNOWN].mean() / LEVELS_PER_DEGREE
    assert abs(mean - json.loads((result / "report.json").read_text())["score"]["mean_deg"]) < 1 / LEVELS_PER_DEGREE


def test_it_is_cut_to_the_object(result):
    shown, normals = open_result(result), load_normals(result)
    x, y = shown.about["origin"]
    rows, columns = np.nonzero(normals.mask)
    assert 0 <= rows.min() - y <= 8 and 0 <= columns.min() - x <= 8


def test_a_truth_of_other_pixels_tells_no_error():
    n = np.zeros((20, 30, 3), np.float32)
    n[..., 2] = 1
    mask = np.arange(30) < 15
    shown = shown_of(
        "x", Normals(n, mask & np.ones((20, 1), bool)), None, None, Normals(n, ~mask & np.ones((20, 1), bool)), {}, None
    )
    assert "mean_error_deg" not in shown.about


def test_of_some_rows_and_columns_places_are_those_of_all():
    n = np.zeros((40, 61, 3), np.float32)
    n[..., 2] = 1
    about = shown_of("x", Normals(n, np.ones((40, 61), bool)), None, None, None, {}, None, every=3).about
    assert (about["every"], about["size"], about["width"], about["height"]) == (3, [61, 40], 21, 14)


def test_without_photographs_the_page_says_so(copy):
    report = json.loads((copy / "report.json").read_text())
    report["source"] = str(copy / "absent")
    (copy / "report.json").write_text(json.dumps(report))
    shown = open_result(copy)
    assert shown.photographs is None and "error" not in shown.layers and "no longer" in shown.about["notes"][0]
    del report["source"], report["reading"]
    (copy / "report.json").write_text(json.dumps(report))
    assert "--capture" in open_result(copy).about["notes"][0]


def test_photographs_that_are_named_are_shown(copy, capture):
    report = json.loads((copy / "report.json").read_text())
    report["source"] = "/nowhere"
    (copy / "report.json").write_text(json.dumps(report))
    assert len(open_result(copy, capture).photographs) == 12


@pytest.fixture
def moved(capture, tmp_path, run):
    """A result whose mask lay beside its photographs and whose lights beside it, all of which have moved since."""
    photographs = shutil.copytree(capture, tmp_path / "photographs")
    shutil.copy(photographs / "mask.png", photographs / "outline.png")
    given = ("--mask", photographs / "outline.png", "--lights", photographs / "light_directions.txt")
    assert (
        run("measure", photographs, "--out", tmp_path / "out", "--method", "woodham", "--memory", "3GB", *given)[0] == 0
    )
    (tmp_path / "out").rename(tmp_path / "result")
    photographs.rename(tmp_path / "new")
    return tmp_path / "result", tmp_path / "new"


def test_masks_and_lights_of_photographs_that_have_moved_move_with_them(moved, monkeypatch):
    result, photographs = moved
    monkeypatch.setattr(memory, "_given", 4 * 10**9)
    assert len(open_result(result, photographs).photographs) == 12
    assert memory.allowed() == 4 * 10**9  # and not what the measurement was allowed
    (photographs / "light_directions.txt").rename(result / "light_directions.txt")
    assert len(open_result(result, photographs).photographs) == 12


def test_why_photographs_that_are_there_cannot_be_used_is_told(moved, run, tmp_path):
    result, photographs = moved
    photographs.rename(tmp_path / "photographs")
    (tmp_path / "photographs" / "outline.png").unlink()
    code, _, err = run("export", result, "--to", "ptm", "--out", tmp_path / "x.ptm")
    assert code == 2 and "outline.png is missing" in err and "no longer" not in err and err.count("\n") == 1


def test_the_page_tells_what_the_measurement_warned_of(copy):
    report = json.loads((copy / "report.json").read_text())
    (copy / "report.json").write_text(json.dumps(report | {"warnings": ["y is flipped"]}))
    assert open_result(copy).about["notes"] == ["Warning: y is flipped"]


def test_lengths_are_told_in_mm(result):
    assert open_result(result).about["mm_per_px"] is None
    assert open_result(result, mm_per_px=0.5).about["mm_per_px"] == 0.5


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda f: shutil.rmtree(f), "is no folder"),
        (lambda f: (f / "normals.npz").unlink(), "holds no normals.npz; give a folder"),
        (lambda f: (f / "report.json").write_text('{"capture": "b'), "report.json can't be read"),
        (lambda f: (f / "report.json").write_text("[1]"), "report.json can't be read"),
        (lambda f: _cut(f / "normals.npz"), "normals.npz can't be read"),
        (lambda f: _cut(f / "depth.npz"), "depth.npz can't be read"),
        (lambda f: _cut(f / "albedo.png"), "albedo.png is truncated"),
        (
            lambda f: np.savez(f / "depth.npz", depth=np.zeros((3, 4)), mask=np.ones((3, 4), bool)),
            "depth.npz is (3, 4)",
        ),
    ],
)
def test_a_result_that_is_none_is_refused_in_one_line(copy, run, tmp_path, spoil, says):
    spoil(copy)
    for command in (("view", copy, "--no-browser"), ("export", copy, "--page", tmp_path / "p.html")):
        code, out, err = run(*command)
        assert code == 2 and says in err and len(err.splitlines()) == 1 and out == ""
    assert not (tmp_path / "p.html").exists()


def test_of_a_folder_of_results_one_is_named(result, run):
    code, _, err = run("export", result.parent, "--page", result.parent / "p.html")
    assert code == 2 and f"a result in it, such as {result.parent}" in err and len(err.splitlines()) == 1


def test_photographs_of_another_size_are_refused(copy, run, tmp_path):
    code, _, err = run("export", copy, "--page", tmp_path / "p.html", "--capture", "demo")
    assert code == 2 and "--capture" in err and len(err.splitlines()) == 1


def _cut(path):
    path.write_bytes(path.read_bytes()[:300])
