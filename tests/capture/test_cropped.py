"""A part of the photographs, and smaller ones: all that is told in pixels follows."""

import json

import numpy as np
import pytest

from photonormal import load, measure
from photonormal.cli import main
from photonormal.srgb import to_linear
from photonormal.types import InputError
from tests.capture.files import LIGHTS, MASK, refusal, samples, write_folder, write_picture

CROP = np.s_[8:18, 6:26]  # of 24 x 30 pixels
TEXT = "6,8,20,10"


def halved(picture: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels."""
    return (picture[::2, ::2] + picture[1::2, ::2] + picture[::2, 1::2] + picture[1::2, 1::2]) / 4


@pytest.mark.parametrize("crop", [TEXT, (6, 8, 20, 10)])
def test_a_crop_is_a_part_of_the_whole(tmp_path, crop):
    folder = write_folder(tmp_path)
    whole, part = load(folder), load(folder, crop=crop)
    assert part.images.shape == (4, 10, 20, 3) and (part.mask == whole.mask[CROP]).all()
    for j in range(4):
        np.testing.assert_array_equal(part.images[j][part.mask], whole.images[j][CROP][part.mask])
    np.testing.assert_array_equal(
        part.window(2, np.s_[1:6], np.s_[4:9])[part.mask[1:6, 4:9]],
        whole.images[2][9:14, 10:15][MASK[9:14, 10:15]],
    )
    np.testing.assert_array_equal(part.window(2, np.s_[1:9:3], np.s_[4:9]), part.window(2, np.s_[1:9], np.s_[4:9])[::3])


def test_samples_are_averaged_in_linear_light(tmp_path):
    folder = write_folder(tmp_path, dtype=np.uint8)
    (folder / "mask.png").unlink()
    small = load(folder, crop=TEXT, scale=0.5, srgb=True)
    assert small.images.shape == (4, 5, 10, 3) and small.mask.all()
    for j in range(4):
        np.testing.assert_allclose(small.images[j], halved(to_linear(samples(j, np.uint8) / 255)[CROP]), rtol=1e-5)
        np.testing.assert_array_equal(small.window(j, np.s_[1:4], np.s_[2:9]), small.images[j][1:4, 2:9])
        np.testing.assert_array_equal(small.window(j, np.s_[1:5:2], np.s_[2:9]), small.images[j][1:5:2, 2:9])


def test_a_scale_that_does_not_divide_keeps_the_mean(tmp_path):
    folder = write_folder(tmp_path)
    (folder / "mask.png").unlink()
    small = load(folder, scale=0.3, crop="0,0,30,20")
    assert small.images.shape == (4, 6, 9, 3)
    np.testing.assert_allclose(small.images[1].mean(), samples(1)[:20].mean() / 65535, rtol=1e-5)


def test_dark_frame_flat_field_and_mask_are_those_of_the_whole(tmp_path):
    folder = write_folder(tmp_path / "a")
    dark = write_picture(tmp_path / "dark.png", samples(7) // 8)
    flat = write_picture(tmp_path / "flat.png", samples(8) // 2 + 30000)
    mask = write_picture(tmp_path / "other.png", np.roll(MASK, 2, 1).astype(np.uint8) * 255)
    whole = load(folder, dark=dark, flat=flat, mask=mask)
    part = load(folder, dark=dark, flat=flat, mask=mask, crop=TEXT)
    assert (part.mask == whole.mask[CROP]).all()
    np.testing.assert_array_equal(part.images[3][part.mask], whole.images[3][CROP][part.mask])
    small = load(folder, dark=dark, flat=flat, mask=mask, crop=TEXT, scale=0.5)
    inside = halved(part.mask.astype(float)) == 1
    np.testing.assert_allclose(small.images[3][inside], halved(part.images[3])[inside], rtol=1e-5)


@pytest.mark.parametrize("focal_px", [None, 1000.0])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_lamps_are_seen_as_before(tmp_path, focal_px, scale):
    folder = write_folder(tmp_path)
    how = {"mm_per_px": 0.5, "dome_radius_mm": 250.0, "focal_px": focal_px}
    whole, part = load(folder, **how), load(folder, crop=TEXT, scale=scale, **how)

    def towards(capture) -> np.ndarray:
        return capture.lamps.positions_mm - capture.camera.plane_mm(*capture.mask.shape)[:, :, None]  # (h, w, n, 3)

    before = towards(whole)[CROP]
    np.testing.assert_allclose(towards(part), before if scale == 1 else halved(before), atol=1e-9)


def test_truth_and_camera_matrix_follow():
    whole, small = load("demo"), load("demo", crop="20,10,120,140", scale=0.5)
    K = np.array([[500.0, 0, 130], [0, 500, 100], [0, 0, 1]])
    found = measure(small, "woodham", examine=False, expected_error=False, albedo=False, K=K)
    assert found.report["crop"] == {
        **{"x": 20, "y": 10, "width": 120, "height": 140},
        **{"photographs": whole.mask.shape, "scale": 0.5},
    }
    assert found.surface is not None and found.surface.K is not None
    pixel = np.array([64, 50.0, 1])  # of the whole
    ray = np.linalg.inv(K) @ pixel
    np.testing.assert_allclose(found.surface.K @ ray, [(64.5 - 20) / 2 - 0.5, (50.5 - 10) / 2 - 0.5, 1])
    assert small.truth is not None and found.report["score"]["mean_deg"] < 20  # as large as on the whole, not 90


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"crop": "20,0,11,24"}, "--crop 20,0,11,24 lies outside the photographs, which are 30 x 24 pixels"),
        ({"crop": "-1,0,5,5"}, "outside"),
        ({"crop": "0,0,0,5"}, "outside"),
        ({"crop": "1,2,3"}, "x,y,width,height"),
        ({"crop": "a,b,c,d"}, "x,y,width,height"),
        ({"crop": "0,0,5,5"}, "shows nothing of"),
        ({"scale": 0.01}, "leaves no pixel"),
    ],
)
def test_refused(tmp_path, how, said):
    assert said in refusal(load, write_folder(tmp_path), **how)


@pytest.mark.parametrize("scale", [0, 2, float("nan")])
def test_scales_that_are_none(tmp_path, scale):
    with pytest.raises(InputError, match="above 0 and at most 1"):
        load(write_folder(tmp_path), scale=scale)


def test_a_saved_crop_is_found_and_what_the_user_says_wins(tmp_path):
    folder = write_folder(tmp_path)
    (folder / "crop.txt").write_text(TEXT + "\n")
    assert load(folder).mask.shape == (10, 20)
    assert load(folder, scale=0.5).mask.shape == (5, 10)
    assert load(folder, crop="0,0,30,24").mask.shape == (24, 30)
    (folder / "crop.txt").write_text("all of it")
    assert "crop.txt 'all of it' came" in refusal(load, folder)


def test_commands_keep_the_crop(tmp_path, capsys):
    out = tmp_path / "out"
    how = ["--method", "woodham", "--no-expected-error", "--crop", "20,10,120,140", "--scale", "0.25"]
    assert main(["measure", "demo", "--out", str(out), *how]) == 0
    with np.load(out / "normals.npz") as found:
        assert found["normals"].shape == (35, 30, 3)
    report = json.loads((out / "report.json").read_text())
    assert report["crop"]["x"] == 20 and report["crop"]["scale"] == 0.25 and report["reading"]["scale"] == 0.25
    capsys.readouterr()
    assert main(["measure", "demo", "--out", str(tmp_path / "none"), "--crop", "0,0,9999,10"]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "none").exists()
    assert main(["check", "demo", "--crop", "20,10,120,140", "--out", str(tmp_path / "checked")]) == 0
    assert json.loads((tmp_path / "checked" / "report.json").read_text())["crop"]["width"] == 120


def test_checked_lamps_are_told_for_the_whole_photographs(tmp_path):
    folder = write_folder(tmp_path)
    np.savetxt(folder / "light_directions.txt", 400 * LIGHTS)
    whole, part = load(folder, mm_per_px=0.5), load(folder, mm_per_px=0.5, crop=TEXT, scale=0.5)
    assert part.crop is not None and part.camera is not None and part.lamps is not None and whole.lamps is not None
    back = part.lamps.positions_mm + part.crop.origin_mm(part.camera)
    np.testing.assert_allclose(back, whole.lamps.positions_mm, atol=1e-9)


def test_diligent_s_file_of_that_name_is_no_crop(tmp_path):
    write_folder(tmp_path)
    (tmp_path / "crop.txt").write_text("8 18 6 26\n")
    assert load(tmp_path).images.shape == (4, 24, 30, 3)
