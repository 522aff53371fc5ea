"""Lights that nobody knows: on the demonstration, whose lights are known; what can't be told; the commands."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal import InputError
from photonormal.capture import lights_from
from photonormal.cli import main
from photonormal.export import load_normals
from photonormal.lighting import FoundLights
from photonormal.methods.learned.lightsnet import LightsConfig, LightsNet
from photonormal.methods.uncalibrated import found_lights
from photonormal.methods.uncalibrated.guess import guess, turned, turned_back
from photonormal.methods.uncalibrated.refine import mended
from photonormal.scoring.lights import score_lights
from photonormal.types import Capture
from photonormal.view.result import photographs_of, report_of
from tests.methods.uncalibrated.test_refine import scattered, shaken
from tests.scenes import lambertian, sphere, write_diligent


@pytest.fixture(scope="module")
def demo():
    return pn.load("demo", lights="unknown")


def test_unknown_lights_are_not_read(demo, tmp_path):
    assert demo.lights is None
    write_diligent(tmp_path / "ball", lambertian(sphere(), scattered(9)))
    np.savetxt(tmp_path / "ball" / "light_intensities.txt", np.full((9, 3), 2.0))
    known, raw = pn.load(tmp_path / "ball"), pn.load(tmp_path / "ball", lights="unknown")
    np.testing.assert_allclose(raw.images[0], 2 * known.images[0], rtol=1e-5)


def test_lights_of_the_demonstration_are_found(demo):
    found = found_lights(demo, "unknown")
    assert score_lights(found.lights, pn.load("demo").known_lights()).mean_deg < 15
    assert found.intensities is not None and found.intensities.mean() == pytest.approx(1)
    assert found.notes and "from the photographs alone" in found.notes[0]


def test_exposure_changes_nothing_and_intensities_are_found_again(demo):
    images = np.stack([demo.images[j] for j in range(24)])
    e = np.linspace(0.7, 1.3, 24).astype(np.float32)
    one, darker, lit = (
        found_lights(Capture(x, demo.mask), "unknown") for x in (images, 0.4 * images, e[:, None, None, None] * images)
    )
    assert score_lights(one.lights, darker.lights).mean_deg < 0.5
    ratio = lit.intensities / one.intensities / e
    assert ratio.std() < 0.1 * ratio.mean()


@pytest.mark.parametrize("case", range(8))
def test_lights_of_turned_pictures_turn_back(case):
    """Where a picture's brightest pixel lies, seen from its middle, is turned like a light."""
    picture = torch.zeros(9, 9)
    picture[1, 6] = 1
    y, x = (int(v) for v in turned(picture, case).nonzero()[0])
    there = torch.tensor([[x - 4.0, 4.0 - y, 1.0]])
    torch.testing.assert_close(turned_back(there, case), torch.tensor([[2.0, 3.0, 1.0]]))


def test_a_quarter_turn_of_the_pictures_turns_the_lights():
    torch.manual_seed(0)
    net = LightsNet(LightsConfig(width=8))
    capture = lambertian(sphere(64), scattered(8))
    images = np.rot90(np.asarray(capture.images), axes=(1, 2))
    one = guess(net, replace(capture, lights=None), torch.device("cpu"))
    other = guess(
        net, Capture(np.ascontiguousarray(images), np.ascontiguousarray(np.rot90(capture.mask))), torch.device("cpu")
    )
    expected = torch.stack([-one.lights[:, 1], one.lights[:, 0], one.lights[:, 2]], dim=1)
    torch.testing.assert_close(other.lights, expected, atol=0.02, rtol=0)


def test_what_tells_no_lights_is_refused():
    capture = replace(lambertian(sphere(48), scattered(9)), lights=None)
    same = np.repeat(np.asarray(capture.images)[:1], 9, axis=0)
    with pytest.raises(InputError, match="shading is the same in all of them"):
        found_lights(replace(capture, images=same), "unknown")
    brighter = same * np.linspace(0.5, 1, 9, dtype=np.float32)[:, None, None, None]
    with pytest.raises(InputError, match="shading is the same in all of them"):
        found_lights(replace(capture, images=brighter), "unknown")
    plane = np.full((9, 48, 48, 1), 0.5, np.float32) * np.linspace(0.5, 1, 9, dtype=np.float32)[:, None, None, None]
    with pytest.raises(InputError, match="shading is the same"):
        found_lights(Capture(plane, np.ones((48, 48), bool)), "unknown")
    with pytest.raises(InputError, match="3 images came but 6 or more are needed"):
        found_lights(Capture(same[:3], capture.mask), "unknown")


def test_lights_of_many_colours_are_told(demo):
    images = np.stack([demo.images[j] for j in range(24)])
    tints = np.random.default_rng(0).uniform(0.4, 1, (24, 1, 1, 3)).astype(np.float32)
    notes = [" ".join(found_lights(Capture(x, demo.mask), "unknown").notes) for x in (images, tints * images)]
    assert ["differ in colour" in note for note in notes] == [False, True]


def test_lights_are_either_unknown_or_mended():
    assert [lights_from(Path("unknown"), False), lights_from(None, True), lights_from(Path("a.lp"), False)] == [
        "unknown", "refined", "given",
    ]  # fmt: skip
    with pytest.raises(InputError, match="drop one"):
        lights_from(Path("unknown"), True)


def test_measure_finds_lights_and_says_so(tmp_path, capsys):
    out = tmp_path / "r"
    arguments = ["measure", "demo", "--lights", "unknown", "--out", str(out), "--method", "trimmed", "--no-mesh"]
    assert main(arguments) == 0
    assert "found from the photographs alone" in capsys.readouterr().err
    report = json.loads((out / "report.json").read_text())
    assert len(report["found_lights"]["directions"]) == len(report["found_lights"]["intensities"]) == 24
    assert report["reading"]["lights"] == "unknown" and report["score"]["mean_deg"] < 25
    assert {"lights.lp", "light_intensities.txt"} <= {p.name for p in out.iterdir()}
    assert main(["score", "demo", str(out)]) == 0
    assert "lights: mean" in capsys.readouterr().out
    assert main(["score", "demo", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["lights"]["mean_deg"] < 15
    photographs, missing = photographs_of(report_of(out), out, None, load_normals(out).mask.shape)
    assert missing is None and photographs is not None
    np.testing.assert_allclose(photographs.lights, report["found_lights"]["directions"], atol=1e-5)


def test_calibrate_writes_what_measure_reads(tmp_path, capsys):
    write_diligent(tmp_path / "ball", lambertian(sphere(64), scattered(12)))
    (tmp_path / "ball" / "light_intensities.txt").unlink()
    out = tmp_path / "found" / "lights.lp"
    out.parent.mkdir()
    assert main(["calibrate", str(tmp_path / "ball"), "--from-object", "--out", str(out)]) == 0
    assert "12 lights" in capsys.readouterr().out
    again = pn.load(tmp_path / "ball", format="folder", lights=out, intensities=out.with_name("light_intensities.txt"))
    assert again.lights is not None and len(again.lights) == 12
    assert main(["calibrate", str(tmp_path / "ball"), "--from-object", "--out", str(out)]) == 2
    assert main(["calibrate", str(tmp_path / "ball"), "--from-object", "--count", "2", "--out", "x.lp"]) == 2
    assert "it is about a sphere" in capsys.readouterr().err


def test_the_doctor_tells_lights_that_are_off_by_some_degrees(tmp_path, capsys):
    true = lambertian(sphere(64), scattered(20))
    assert mended(true) is None and mended(replace(true, lights=None)) is None
    write_diligent(tmp_path / "ball", true)
    np.savetxt(tmp_path / "ball" / "light_directions.txt", shaken(true.lights, 5))
    assert main(["check", str(tmp_path / "ball"), "--out", str(tmp_path / "c")]) == 0
    said = capsys.readouterr().out
    assert "measure with --refine-lights" in said
    fixed = pn.load(tmp_path / "ball", lights=tmp_path / "c" / "corrected.lp")
    assert score_lights(fixed.known_lights(), true.known_lights()).mean_deg < 2.5
    found = pn.check(pn.load(tmp_path / "ball"))
    assert found[-1].kind == "lights" and said.splitlines()[-1].endswith("--refine-lights --out result")
    told = pn.measure(pn.load(tmp_path / "ball"), "woodham", integration=None, expected_error=False).report
    assert told["warnings"] == [finding.message for finding in found]


def test_lights_that_are_off_by_much_more_are_doubted_and_not_mended_unasked():
    true = lambertian(sphere(64), scattered(20))
    (found,) = pn.check(replace(true, lights=shaken(true.lights, 20)))
    assert found.kind == "lights" and found.lights is None and "another capture's" in found.message


def test_of_one_light_that_is_off_by_far_the_photograph_is_named_and_no_light_offered():
    true = lambertian(sphere(64), scattered(20))
    L = true.known_lights().copy()
    L[7] = [0.0, 0.0, 1.0]
    (found,) = pn.check(replace(true, lights=L))
    assert found.kind == "lights" and found.lights is None and "Look at that photograph" in found.message
    assert true.image_names[7] in found.message


def test_intensities_that_were_found_are_not_blamed_on_a_file():
    true = lambertian(sphere(64), scattered(20))
    told = FoundLights(true.known_lights(), np.where(np.arange(20) == 7, 1.6, 1.0))
    assert [f.kind for f in pn.check(told.shown_by(true))] == ["intensities"]
    assert not pn.check(told.shown_by(true), told)
