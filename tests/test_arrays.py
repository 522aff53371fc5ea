"""Arrays as people have them give the same normals, or one line that says what to give."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal.geometry import angle_deg
from photonormal.methods import METHODS
from photonormal.types import Capture, Normals, Surface
from tests.capture.files import refusal
from tests.scenes import lambertian, ring, sphere

TRUTH, LIGHTS = sphere(), ring(8)
PLAIN = lambertian(TRUTH, LIGHTS)
IMAGES = np.asarray(PLAIN.images)


def error_deg(capture: Capture) -> float:
    return pn.score(pn.solve(capture, "woodham"), TRUTH).mean_deg


EXPECTED = error_deg(PLAIN)


@pytest.mark.parametrize(
    "images",
    [
        IMAGES.astype(np.float64),
        IMAGES[..., 0],
        np.rint(IMAGES * 65535).astype(np.uint16),
        list(IMAGES),
        [image[..., 0].tolist() for image in IMAGES],
        np.repeat(IMAGES, 3, axis=-1),
        np.asfortranarray(IMAGES),
    ],
    ids=["float64", "grey", "uint16", "list", "nested lists", "colour", "Fortran"],
)
def test_images_of_any_kind(images):
    capture = Capture(images, TRUTH.mask, LIGHTS.tolist())
    assert capture.images.shape[:3] == (9, 48, 48) and np.asarray(capture.images).dtype == np.float32
    assert abs(error_deg(capture) - EXPECTED) < 0.01


def test_integers_are_one_at_full_scale():
    images = np.full((4, 5, 6, 1), 255, np.uint8)
    assert (Capture(images, None, LIGHTS[[0, 2, 4, 8]]).images[0] == 1).all()


@pytest.mark.parametrize("mask", [TRUTH.mask * 255, TRUTH.mask.astype(np.uint8), TRUTH.mask.astype(float)])
def test_masks_of_numbers(mask):
    assert (Capture(IMAGES, mask, LIGHTS).mask == TRUTH.mask).all()


@pytest.mark.parametrize("method", ["woodham", "lmps", "normalnet"])
@pytest.mark.parametrize("exposure", [1e-25, 1e20])
def test_samples_of_any_size(method, exposure):
    images = np.float32(exposure) * IMAGES
    images[:, ~TRUTH.mask] = np.finfo(np.float32).max  # beside the object
    capture = Capture(images, TRUTH.mask, LIGHTS)
    assert "all were divided by that" in capture.notes[0]
    bright = replace(PLAIN, images=IMAGES / IMAGES.max())
    assert angle_deg(pn.solve(capture, method).map, pn.solve(bright, method).map)[TRUTH.mask].max() < 0.01


def test_what_is_no_number_is_dark_and_what_is_infinite_is_bright():
    images = IMAGES.copy()
    images[2, 20, 20], images[3, 20, 20], images[4, 21, 21] = np.nan, -np.inf, np.inf
    images[5, 0, 0] = np.nan  # beside the object
    capture = Capture(images, TRUTH.mask, LIGHTS)
    found = np.asarray(capture.images)
    assert "of 2 pixels inside the mask some samples are NaN" in capture.notes[0] and not PLAIN.notes
    assert found[2, 20, 20] == found[3, 20, 20] == 0 and found[4, 21, 21] == IMAGES.max()


def test_without_a_mask_all_pixels_are_on_the_object():
    assert Capture(IMAGES, lights=LIGHTS).mask.all()


@pytest.mark.parametrize(
    ("images", "said"),
    [
        (np.zeros((4, 5, 6), np.int64), "int64"),
        (np.zeros((4, 5, 6), bool), "bool"),
        (np.zeros((4, 5, 6), complex), "complex128"),
        ([np.zeros((3, 4)), np.zeros((4, 3))], "several sizes"),
        ("folder", "photonormal.load reads files"),
        (np.array([["a"]]), "numbers are needed"),
    ],
)
def test_other_images(images, said):
    assert said in refusal(Capture, images, None, LIGHTS[:4])


def test_orders_of_axes_are_named():
    assert "moveaxis" in refusal(Capture, np.moveaxis(IMAGES[..., 0], 0, -1), None, LIGHTS)
    assert "transpose" in refusal(Capture, IMAGES, TRUTH.mask, LIGHTS.T)
    assert "numbers" in refusal(Capture, IMAGES, TRUTH.mask, "lights.txt")


def test_maps_of_normals():
    map = TRUTH.map.astype(np.float64)
    assert (Normals(map).mask == TRUTH.mask).all()
    assert (Normals(np.where(TRUTH.mask[..., None], map, np.nan)).mask == TRUTH.mask).all()
    assert pn.score(map, TRUTH.map).mean_deg < 1e-4 and pn.integrate(map).mask.sum() == TRUTH.mask.sum()
    assert "(48, 48)" in refusal(Normals, map[..., 0])


def test_values_are_arrays_and_short_to_read(tmp_path):
    surface = pn.integrate(TRUTH)
    assert np.asarray(TRUTH) is TRUTH.map and np.asarray(TRUTH, np.float64).dtype == np.float64
    assert np.array(TRUTH) is not TRUTH.map and np.asarray(surface).shape == (48, 48)
    assert angle_deg(np.asarray(TRUTH), TRUTH.map)[TRUTH.mask].max() == 0
    result = pn.measure(PLAIN, "woodham", examine=False)
    for value in (PLAIN, TRUTH, surface, result, Surface(np.full((2, 2), np.nan), np.ones((2, 2), bool))):
        assert len(repr(value)) < 500 and "\n" not in repr(value)
        assert value._repr_png_().startswith(b"\x89PNG")
    assert "9 photographs of 48 x 48 x 1" in repr(PLAIN)


def test_mistakes_are_one_line():
    """In a process of its own: the tests' own checks of types would come first."""
    code = """
import photonormal as pn
n = pn.Normals([[[0, 0, 1]]])
for call in (lambda: pn.solve("demo"), lambda: pn.measure("demo"), lambda: pn.check(3), lambda: pn.score(n, None),
             lambda: pn.score(None, n), lambda: pn.integrate("n.png"), lambda: pn.save("n.png", "m.png"),
             lambda: pn.solve(pn.load("demo"), len)):
    try:
        call()
    except pn.InputError as error:
        print(error)
"""
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(said) == 8 and all("is needed; " in line for line in said)
    assert said[0].startswith("'demo' came but a Capture is needed") and said[3].startswith("the true normals are None")


def test_help_lists_the_methods():
    for name in METHODS:
        assert name in (pn.solve.__doc__ or "")


def test_the_package_is_typed():
    from importlib.resources import files

    assert (files("photonormal") / "py.typed").is_file()
