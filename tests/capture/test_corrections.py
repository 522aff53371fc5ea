"""Photographs as they come: dark frame, flat field, hot pixels, distortion, frames of the lights."""

import numpy as np
import pytest

import photonormal as pn
from photonormal.capture.corrections import hot_pixels
from photonormal.capture.lens import Lens, read_lens
from photonormal.geometry import FRAMES, angle_deg, from_frame, in_frame
from photonormal.types import InputError
from tests.scenes import lambertian, ring, sphere, write_diligent


def png(path, fraction) -> None:
    """A 16-bit grey picture."""
    import cv2

    cv2.imencode(".png", np.rint(65535 * np.asarray(fraction).clip(0, 1)).astype(np.uint16))[1].tofile(path)


@pytest.fixture
def shot(tmp_path):
    """A sphere through a lens that darkens corners, in a room with a lamp on, by a sensor with hot pixels."""
    right = lambertian(sphere(), ring(8, 60), albedo=0.6)
    y, x = np.mgrid[-1:1:48j, -1:1:48j]
    flat = 1 - 0.35 * (x**2 + y**2)
    dark = 0.05 + 0.03 * (x > 0.2)
    dark[20, 30] = dark[31, 18] = 0.4
    images = np.asarray(right.images) * flat[..., None] + dark[..., None]
    write_diligent(tmp_path / "object", pn.Capture(images.astype(np.float32), right.mask, right.lights, right.truth))
    png(tmp_path / "dark.png", dark)
    png(tmp_path / "flat.png", 0.8 * flat + dark)
    return tmp_path, right


def off(capture, truth) -> float:
    return pn.score(pn.solve(capture), truth).mean_deg


def test_dark_and_flat_restore_the_capture(shot):
    folder, right = shot
    bad = pn.load(folder / "object")
    good = pn.load(folder / "object", dark=folder / "dark.png", flat=folder / "flat.png")
    inside = right.mask.copy()
    inside[20, 30] = inside[31, 18] = False  # hot pixels saturate
    found = np.stack([good.images[j].mean(-1) for j in range(9)])[:, inside]
    expected = np.asarray(right.images)[..., 0][:, inside]
    assert np.abs(found - expected * found.mean() / expected.mean()).max() < 1e-3  # a flat field's scale is free
    truth = right.truth
    assert off(good, truth) < off(right, truth) + 0.01 < off(bad, truth) / 2


def test_hot_pixels_are_found_in_the_dark_frame_and_in_the_pictures(shot):
    folder, _ = shot
    for given in ({"dark": folder / "dark.png"}, {}):
        capture = pn.load(folder / "object", hot_pixels=True, **given)
        assert capture.images.hot[20, 30] and capture.images.hot[31, 18] and capture.images.hot.sum() <= 4
        image = capture.images[0]
        assert abs(image[20, 30] - image[20, 29]).max() < 0.1


@pytest.mark.parametrize("how", [("dark",), ("flat",), ("dark", "flat")])
def test_samples_that_were_white_stay_known_as_white(shot, how):
    folder, right = shot
    bright = (1.8 * np.asarray(right.images) + 0.05).clip(0, 1)
    write_diligent(folder / "object", pn.Capture(bright, right.mask, right.lights, right.truth))
    raw = pn.load(folder / "object")
    capture = pn.load(folder / "object", **{name: folder / f"{name}.png" for name in how})
    everywhere = np.s_[:, :]
    white = np.stack([raw.saturated(j, *everywhere, raw.images[j]) for j in range(9)])
    told = np.stack([capture.saturated(j, *everywhere, capture.images[j]) for j in range(9)])
    assert 10 < white.sum() < white.size / 2 and (told == white).all()
    part = pn.load(folder / "object", crop="12,10,20,24", **{name: folder / f"{name}.png" for name in how})
    there = np.stack([part.saturated(j, *everywhere, part.images[j]) for j in range(9)])
    assert (there == white[:, 10:34, 12:32]).all()


def test_an_even_surface_has_no_hot_pixels():
    rng = np.random.default_rng(0)
    assert not hot_pixels((0.3 + 0.003 * rng.standard_normal((60, 60, 1))).astype(np.float32)).any()


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"dark": "small.png"}, "dark frame .* take it with the same camera"),
        ({"flat": "black.png"}, "black on most of the frame"),
        ({"flat": "white.png"}, "100 % of the flat field .* is white.* expose less"),
        ({"flat": "holes.png"}, "of the flat field .* is black"),
        ({"lens": "text.yml"}, "lens calibration|has no camera_matrix"),
        ({"frame": "left-handed"}, "no frame 'left-handed'; choose from opengl"),
        ({"intensities": "absent.txt"}, "absent.txt is missing"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(shot, how, says):
    folder, _ = shot
    png(folder / "small.png", np.ones((10, 10)))
    png(folder / "black.png", np.zeros((48, 48)))
    png(folder / "white.png", np.ones((48, 48)))
    png(folder / "holes.png", np.where(np.arange(48) < 5, 0, 0.8) * np.ones((48, 1)))
    (folder / "text.yml").write_text("hello: [")
    named = {k: v if k == "frame" else folder / v for k, v in how.items()}
    with pytest.raises(InputError, match=says) as error:
        pn.load(folder / "object", **named)
    assert "\n" not in str(error.value)


def calibration(path, k1: float) -> Lens:
    import cv2

    K, distortion = np.array([[60.0, 0, 23.5], [0, 60, 23.5], [0, 0, 1]]), np.array([k1, 0, 0, 0, 0])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", distortion)
    storage.release()
    return Lens(K, distortion)


@pytest.mark.parametrize("name", ["lens.yml", "lens.xml", "lens.json"])
def test_a_calibration_is_read_as_opencv_wrote_it(tmp_path, name):
    written = calibration(tmp_path / name, -0.2)
    read = read_lens(tmp_path / name)
    assert np.allclose(read.K, written.K) and np.allclose(read.distortion, written.distortion)


def test_straight_lines_come_out_straight(tmp_path):
    """A pixel at radius r of the undistorted picture shows what lay at r (1 + k1 r^2)."""
    lens = calibration(tmp_path / "lens.yml", -0.2)
    x = np.mgrid[:48, :48][1].astype(np.float32)
    out = lens.undistorted(x[..., None])[..., 0]
    u, v = (40 - 23.5) / 60, (10 - 23.5) / 60
    assert out[10, 40] == pytest.approx(23.5 + 60 * u * (1 - 0.2 * (u**2 + v**2)), abs=0.05)


def test_the_mask_is_undistorted_with_the_pictures(shot):
    folder, right = shot
    calibration(folder / "lens.yml", -0.3)
    capture = pn.load(folder / "object", lens=folder / "lens.yml")
    assert capture.mask.sum() > right.mask.sum() * 1.05  # a barrel lens showed it smaller
    assert capture.images[0].shape == (48, 48, 3)


def test_no_distortion_changes_nothing(shot):
    folder, _ = shot
    calibration(folder / "lens.yml", 0.0)
    a, b = pn.load(folder / "object"), pn.load(folder / "object", lens=folder / "lens.yml")
    assert (a.mask == b.mask).all() and np.abs(a.images[3] - b.images[3])[a.mask].max() < 1e-5


@pytest.mark.parametrize("frame", FRAMES)
def test_lights_of_every_frame_come_out_the_same(shot, tmp_path, frame):
    folder, right = shot
    np.savetxt(tmp_path / "lights.txt", in_frame(right.lights, frame))
    assert (
        angle_deg(pn.load(folder / "object", lights=tmp_path / "lights.txt", frame=frame).lights, right.lights).max()
        < 1e-5
    )


@pytest.mark.parametrize("frame", FRAMES)
def test_a_frame_applied_twice_is_the_identity(frame):
    v = np.array([[0.1, -0.5, 0.8]])
    assert (from_frame(in_frame(v, frame), frame) == v).all()
