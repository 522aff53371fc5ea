"""From photographs to results, as a user runs it."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

import photonormal as pn
from photonormal.capture import images, store
from photonormal.export import load_normals
from photonormal.export.result import photograph
from photonormal.files import memory
from photonormal.masked import box_of
from photonormal.methods import DEFAULT
from photonormal.types import Capture
from tests.scenes import lambertian, ring, sphere, write_diligent

FILES = {"normals.png", "normals.npz", "albedo.png", "depth.npz", "mesh.ply", "preview.png", "report.json", "error.png"}
FILES |= {"expected-error.png", "thumbnail.png"}


@pytest.fixture
def folder(tmp_path):
    """A matt sphere under nine lights, as a DiLiGenT object in a folder with blanks and letters beyond ASCII."""
    path = tmp_path / "mein Gefäß 壺"
    write_diligent(path, lambertian(sphere(), ring(8, 50)))
    return path


@pytest.mark.parametrize("lights", ["given", "refined"])
def test_materials_under_lights_that_were_mended_are_doubted(folder, lights):
    quick = {"expected_error": False, "examine": False, "integration": None}
    result = pn.measure(pn.load(folder), "woodham", lights=lights, materials=True, **quick)
    assert any("base_colour.png" in told for told in result.report["warnings"]) == (lights == "refined")


def test_every_file_is_written_and_the_normals_are_right(folder, tmp_path, run):
    code, out, err = run("measure", folder, "--out", tmp_path / "result")
    assert (code, err) == (0, "")
    assert {p.name for p in (tmp_path / "result").iterdir()} == FILES
    report = json.loads((tmp_path / "result" / "report.json").read_text())
    assert report["lights"] == 9 and report["pixels"]["dark"] == 0 and report["method"] == DEFAULT
    stages = {"read", "check", "solve", "expected error", "albedo", "integrate", "inter-reflections", "export"}
    assert set(report["seconds"]) == stages
    assert report["score"]["mean_deg"] < 2  # a few lights leave the rim in attached shadow
    assert "degrees against the true normals" in out
    assert re.search(r"off by [0-9.]+ degrees on average: \S+expected-error.png", out)


@pytest.mark.parametrize("method", ["woodham", "lambertian-prior", "normalnet"])
@pytest.mark.parametrize("where", ["memory", "scratch"])
def test_every_picture_is_decoded_once(folder, monkeypatch, method, where):
    """By the whole of a measurement: report, checks, normals in several passes, expected errors, albedo, preview."""
    decoded, decode = [], images.decode

    def counted(path, frame=None):
        decoded.append(path.name)
        return decode(path, frame)

    monkeypatch.setattr(images, "decode", counted)
    if where == "scratch":
        monkeypatch.setattr(memory, "holds", lambda nbytes: False)
        monkeypatch.setattr(store, "SIDE", 16)
    result = pn.measure(pn.load(folder), method, device="cpu")
    photograph(result, box_of(result.normals.mask))
    assert sorted(decoded) == sorted({f"{j + 1:03d}.png" for j in range(9)})


def test_score_prints_one_json_object_with_the_contract_s_names(folder, tmp_path, run):
    run("measure", folder, "--out", tmp_path / "result")
    code, out, _ = run("score", folder, tmp_path / "result", "--json")
    assert code == 0
    assert set(json.loads(out)) == {"mean_deg", "median_deg", "below_15", "below_30", "pixels"}


def test_the_surface_of_a_measured_sphere_is_round(folder, tmp_path, run):
    run("measure", folder, "--out", tmp_path / "result")
    with np.load(tmp_path / "result" / "depth.npz") as data:
        depth, mask = data["depth"], data["mask"]
    row, column = np.nonzero(mask)
    # a sphere's depth: z = sqrt(r^2 - x^2 - y^2) + constant, with r in pixels
    r = 0.9 * 47 / 2
    z = np.sqrt(r**2 - (column - 23.5) ** 2 - (row - 23.5) ** 2)
    difference = depth[mask] - z
    assert difference.std() < 0.05 * r


def test_integrate_turns_the_result_into_a_mesh(folder, tmp_path, run):
    run("measure", folder, "--out", tmp_path / "result", "--no-mesh")
    assert not (tmp_path / "result" / "mesh.ply").exists()
    code, *_ = run("integrate", tmp_path / "result", "--out", tmp_path / "ball.obj")
    assert code == 0 and (tmp_path / "ball.obj").stat().st_size > 10000
    code, _, err = run("integrate", tmp_path / "result", "--out", tmp_path / "ball.obj")
    assert code == 2 and "--overwrite" in err


def test_a_method_takes_options(folder, tmp_path, run):
    method = "trimmed:lowest=0.2:least=4"
    assert run("measure", folder, "--out", tmp_path / "result", "--method", method, "--no-mesh")[0] == 0
    options = json.loads((tmp_path / "result" / "report.json").read_text())["options"]
    assert options == {"lowest": 0.2, "highest": 0.6, "least": 4}
    code, _, err = run("measure", folder, "--out", tmp_path / "other", "--method", "trimmed:last=1")
    assert code == 2 and "no option 'last'; it has lowest" in err
    code, _, err = run("measure", folder, "--out", tmp_path / "other", "--method", "normalnet:name=x")
    assert code == 2 and "no option 'name'; it has weights, rotations, prior, passes, fast, even." in err


def test_a_reader_that_goes_early_is_no_error():
    command = f"{sys.executable} -m photonormal methods | true"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert done.stderr == ""


def test_a_subset_is_measured_and_reported(folder, tmp_path, run):
    code, *_ = run("measure", folder, "--out", tmp_path / "result", "--images", "1-3,9", "--no-mesh")
    report = json.loads((tmp_path / "result" / "report.json").read_text())
    assert code == 0 and report["images"] == ["001.png", "002.png", "003.png", "009.png"]


def test_fast_is_an_option_of_the_method_that_has_it(folder, tmp_path, run):
    code, *_ = run("measure", folder, "--out", tmp_path / "result", "--fast", "--no-mesh")
    report = json.loads((tmp_path / "result" / "report.json").read_text())
    assert code == 0 and report["options"]["fast"] and report["score"]["mean_deg"] < 3
    assert report["expected_error_deg"] > 0
    code, _, err = run("measure", folder, "--out", tmp_path / "other", "--fast", "--method", "trimmed")
    assert code == 2 and "trimmed has no option 'fast'" in err and not (tmp_path / "other").exists()


def test_dark_pixels_have_no_normal_and_are_counted(tmp_path, run):
    capture = lambertian(sphere(), ring(8, 70))
    images = np.array(capture.images)
    images[:, 20:24, 20:24] = 0
    write_diligent(tmp_path / "dark", Capture(images, capture.mask, capture.lights, truth=capture.truth))
    code, _, err = run("measure", tmp_path / "dark", "--out", tmp_path / "result")
    assert code == 0 and "16 pixels" in err
    normals = load_normals(tmp_path / "result")
    assert not normals.mask[20:24, 20:24].any() and (normals.map[20:24, 20:24] == 0).all()
    with np.load(tmp_path / "result" / "depth.npz") as data:
        assert not data["mask"][20:24, 20:24].any()


def test_saturation_is_counted_and_warned_about(tmp_path, run):
    capture = lambertian(sphere(), ring(8, 70), albedo=1.6)
    write_diligent(tmp_path / "bright", capture)
    code, _, err = run("measure", tmp_path / "bright", "--out", tmp_path / "result", "--no-mesh")
    samples = json.loads((tmp_path / "result" / "report.json").read_text())["samples"]
    inside = np.stack([np.asarray(capture.images[j])[capture.mask] for j in range(9)])
    assert code == 0 and samples["saturated_percent"] == pytest.approx(100 * (inside >= 1 - 1e-5).mean(), abs=0.1)
    assert "saturated" in err and "expose less" in err


def test_images_cut_from_the_frame_stay_in_the_frame(folder, tmp_path, run):
    run("measure", folder, "--out", tmp_path / "result", "--no-mesh")
    assert load_normals(tmp_path / "result").mask.shape == (48, 48)


def test_a_perspective_camera_gives_a_perspective_surface(folder, tmp_path, run):
    (tmp_path / "K.txt").write_text("500 0 24\n0 500 24\n0 0 1\n")
    code, *_ = run("measure", folder, "--out", tmp_path / "result", "--camera", tmp_path / "K.txt")
    with np.load(tmp_path / "result" / "depth.npz") as data:
        assert code == 0 and data["K"][0, 0] == 500 and np.nanmean(data["depth"]) == pytest.approx(1, abs=1e-3)


class TestRefusals:
    """One line on standard error, exit code 2, nothing written."""

    def refused(self, run, tmp_path, *arguments, says: str):
        before = sorted(tmp_path.rglob("*"))
        code, out, err = run(*arguments)
        assert code == 2 and out == ""
        assert err.startswith("photonormal: ") and err.count("\n") == 1 and says in err, err
        assert sorted(tmp_path.rglob("*")) == before

    def measure(self, run, tmp_path, path, *more, says: str):
        self.refused(run, tmp_path, "measure", path, "--out", tmp_path / "result", *more, says=says)

    def test_no_capture(self, tmp_path, run):
        self.measure(run, tmp_path, tmp_path / "absent", says="does not exist")

    def test_a_truncated_picture(self, folder, tmp_path, run):
        data = (folder / "004.png").read_bytes()
        (folder / "004.png").write_bytes(data[: len(data) // 2])
        self.measure(run, tmp_path, folder, says="004.png is truncated")

    def test_a_missing_picture(self, folder, tmp_path, run):
        (folder / "004.png").unlink()
        self.measure(run, tmp_path, folder, says="004.png is missing")

    def test_too_few_lights(self, folder, tmp_path, run):
        lines = (folder / "light_directions.txt").read_text().splitlines()
        (folder / "light_directions.txt").write_text("\n".join(lines[:-1]))
        self.measure(run, tmp_path, folder, says="9 pictures but 8 light directions")

    def test_lights_in_one_plane(self, folder, tmp_path, run):
        np.savetxt(folder / "light_directions.txt", [[np.sin(a), 0, np.cos(a)] for a in np.linspace(-1, 1, 9)])
        self.measure(run, tmp_path, folder, says="condition number")

    def test_two_images(self, folder, tmp_path, run):
        self.measure(run, tmp_path, folder, "--images", "1,2", says="at least 3")

    def test_an_unknown_method(self, folder, tmp_path, run):
        self.measure(run, tmp_path, folder, "--method", "magic", says="no method 'magic'; choose from normalnet")

    def test_an_unknown_integration(self, folder, tmp_path, run):
        self.measure(run, tmp_path, folder, "--integration", "magic", says="magic")

    def test_an_unknown_device(self, folder, tmp_path, run):
        self.measure(run, tmp_path, folder, "--device", "abacus", says="abacus")

    def test_an_empty_mask(self, folder, tmp_path, run):
        import cv2

        cv2.imencode(".png", np.zeros((48, 48), np.uint8))[1].tofile(folder / "mask.png")
        self.measure(run, tmp_path, folder, says="the mask is empty")

    def test_nothing_but_darkness(self, tmp_path, run):
        capture = lambertian(sphere(), ring(8, 70), albedo=0)
        write_diligent(tmp_path / "black", capture)
        self.measure(run, tmp_path, tmp_path / "black", says="dark")

    def test_a_folder_that_is_not_ours(self, folder, tmp_path, run):
        (tmp_path / "result").mkdir()
        (tmp_path / "result" / "thesis.txt").write_text("mine")
        self.measure(run, tmp_path, folder, says="--overwrite")

    @pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="nothing is forbidden to root")
    def test_no_permission(self, folder, tmp_path, run):
        (tmp_path / "locked").mkdir(mode=0o500)
        self.refused(
            run, tmp_path, "measure", folder, "--out", tmp_path / "locked" / "result", says="permission is denied"
        )

    def test_a_result_inside_a_file(self, folder, tmp_path, run):
        (tmp_path / "file").write_text("x")
        self.refused(run, tmp_path, "measure", folder, "--out", tmp_path / "file" / "result", says="can't be written")

    def test_no_truth_to_score_against(self, folder, tmp_path, run):
        (folder / "Normal_gt.mat").unlink()
        run("measure", folder, "--out", tmp_path / "result", "--no-mesh")
        self.refused(run, tmp_path, "score", folder, tmp_path / "result", says="no true normals")


@pytest.mark.data
@pytest.mark.parametrize(("name", "published"), [("ball", 4.10), ("bear", 8.39), ("cat", 8.41), ("reading", 19.80)])
def test_least_squares_reproduces_the_published_figures(data, tmp_path, run, name, published):
    folder = data / "diligent" / "pmsData" / f"{name}PNG"
    assert run("measure", folder, "--out", tmp_path / name, "--method", "woodham", "--no-mesh")[0] == 0
    _, out, _ = run("score", folder, tmp_path / name, "--json")
    assert round(json.loads(out)["mean_deg"], 2) == published
