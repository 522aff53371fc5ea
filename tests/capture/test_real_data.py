"""Real captures: every count, size and bit depth, and exact samples beside OpenCV's."""

import cv2
import numpy as np
import pytest

from photonormal import load

pytestmark = pytest.mark.data


@pytest.mark.parametrize(("name", "pixels"), [("ball", 15791), ("bear", 41512), ("cat", 45200), ("reading", 27654)])
def test_diligent(data, name, pixels):
    folder = data / "diligent" / "pmsData" / f"{name}PNG"
    top, bottom, left, right = np.loadtxt(folder / "crop.txt", dtype=int)
    capture = load(folder)
    assert capture.name == name and capture.images.shape == (96, bottom - top, right - left, 3)
    assert capture.mask.sum() == pixels and capture.truth is not None
    assert (capture.truth.mask & capture.mask).sum() == pixels
    intensities = np.loadtxt(folder / "light_intensities.txt")
    for j in (0, 41, 95):
        picture = cv2.imread(str(folder / f"{j + 1:03d}.png"), cv2.IMREAD_UNCHANGED)
        assert picture is not None and picture.dtype == np.uint16 and len(np.unique(picture % 256)) > 100
        exact = picture[..., ::-1][capture.mask] / 65535 / intensities[j]
        np.testing.assert_allclose(capture.images[j][capture.mask], exact, rtol=2e-7)
    lights = np.loadtxt(folder / "light_directions.txt")
    np.testing.assert_allclose(
        capture.known_lights(), lights / np.linalg.norm(lights, axis=1, keepdims=True), rtol=1e-12
    )


def test_photographs_with_the_lights_of_a_sphere(data, tmp_path):
    L = np.random.default_rng(0).normal([0, 0, 4], 1, (12, 3))
    rows = [f"chrome.{j}.png {a} {b} {c}" for j, (a, b, c) in enumerate(L)]
    (tmp_path / "chrome.lp").write_text("\n".join(["12", *rows]))
    capture = load(data / "captures" / "uw" / "owl", lights=tmp_path / "chrome.lp")
    assert capture.images.shape == (12, 340, 512, 3)
    assert capture.image_names[9:] == ("owl.9.png", "owl.10.png", "owl.11.png")
    assert 0.05 < capture.mask.mean() < 0.5
    np.testing.assert_allclose(capture.known_lights(), L / np.linalg.norm(L, axis=1, keepdims=True))
    picture = cv2.imread(str(data / "captures" / "uw" / "owl" / "owl.10.png"))
    assert picture is not None
    np.testing.assert_allclose(capture.images[10][capture.mask], picture[..., ::-1][capture.mask] / 255, rtol=1e-6)


def test_grey_photographs_with_lights_in_three_rows(data):
    frog = data / "captures" / "harvard" / "frog"
    capture = load(frog / "Objects", lights=frog / "light_directions.txt")
    assert capture.images.shape[0] == 20 and capture.images.shape[3] == 1 and capture.mask.all()
    np.testing.assert_allclose(np.linalg.norm(capture.known_lights(), axis=1), 1)
    np.testing.assert_allclose(capture.known_lights()[0, :2], [-0.3522, 0.5350], atol=1e-3)
