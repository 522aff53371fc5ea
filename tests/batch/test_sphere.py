"""Lights of a batch's captures from mirror spheres."""

import json

import numpy as np
import pytest

import photonormal as pn
from photonormal.cli import main
from photonormal.geometry import angle_deg
from tests.batch.conftest import normals
from tests.calibration.chrome import dome, write_chrome
from tests.scenes import lambertian, sphere, write_diligent

LIGHTS = dome(9)


@pytest.fixture
def season(tmp_path):
    """Matt spheres without their lights, and chrome under the same lights: inside the first one's folder, or beside."""
    for name in ("vase-0", "vase-1"):
        write_diligent(tmp_path / "season" / name, lambertian(sphere(40), LIGHTS))
        (tmp_path / "season" / name / "light_directions.txt").unlink()
    write_chrome(tmp_path / "season" / "vase-0" / "chrome", LIGHTS)
    write_chrome(tmp_path / "chrome", LIGHTS)
    return tmp_path / "season"


def error_deg(results, name):
    """Of most pixels; attached shadows spoil least squares at the rim."""
    truth = sphere(40)
    return np.median(angle_deg(normals(results, name)[truth.mask], truth.map[truth.mask]))


def test_a_sphere_in_each_capture_or_one_for_all(season, tmp_path, here, batch, monkeypatch):
    monkeypatch.chdir(tmp_path)
    results = tmp_path / "results"
    code, _, err = batch("--sphere", "chrome")
    assert (code, err) == (0, "") and error_deg(results, "vase-0") < 1 and error_deg(results, "vase-1") < 1
    for name, own in (("vase-0", "chrome/01.png"), ("vase-1", str(tmp_path / "chrome" / "01.png"))):
        report = json.loads((results / name / "report.json").read_text())
        assert own in report["provenance"]["inputs"]["files"]
        assert report["reading"]["lights"] == str(results / name / "sphere.lp")
        assert not any("photonormal-" in path for path in report["provenance"]["inputs"]["files"])
    again = pn.load(season / "vase-1", lights=results / "vase-1" / "sphere.lp")  # as `view` reads it
    assert angle_deg(again.lights, LIGHTS).max() < 0.5
    assert "0 measured, 2 were done" in batch("--sphere", "chrome")[1]
    (season / "vase-0" / "chrome" / "01.png").write_bytes((tmp_path / "chrome" / "02.png").read_bytes())
    (season / "vase-0" / "chrome" / "02.png").write_bytes((tmp_path / "chrome" / "01.png").read_bytes())
    code, out, err = batch("--sphere", "chrome")
    assert code == 0 and "1 measured, 1 were done" in out and "vase-0 is measured again: chrome/0" in err


def test_auto_takes_a_capture_s_own_lights_where_it_shows_no_sphere(season, tmp_path, here, batch):
    np.savetxt(season / "vase-0" / "light_directions.txt", LIGHTS)
    code, _, err = batch("--sphere", "auto")
    assert code == 1 and err.count("\n") == 1 and "vase-1: " in err and "No sphere gave lights either" in err
    assert "refused.png" not in err
    report = json.loads((tmp_path / "results" / "vase-0" / "report.json").read_text())
    assert error_deg(tmp_path / "results", "vase-0") < 1 and "own lights were used" in report["warnings"][-1]


def test_measure_finds_lights_by_the_same_sphere(season, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    how = ["--method", "woodham", "--no-mesh", "--no-expected-error"]
    assert main(["measure", str(season / "vase-0"), "--sphere", "chrome", *how, "--out", "result"]) == 0
    own = json.loads((tmp_path / "result" / "report.json").read_text())["provenance"]["inputs"]["files"]
    assert "chrome/01.png" in own and error_deg(tmp_path, "result") < 1
    assert main(["measure", str(season / "vase-0"), "--sphere", "chrome", *how, "--out", "result"]) == 0  # once more
    assert main(["measure", str(season / "vase-1"), "--sphere", "nowhere", *how, "--out", "other"]) == 2
    assert not (tmp_path / "other").exists()
