"""What explains pictures that their lights don't: the right explanation is told, and none where nothing is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from photonormal.doctor import check
from photonormal.geometry import angle_deg, normalised
from photonormal.types import Capture
from tests.calibration.chrome import dome
from tests.doctor.test_check import bumps, noisy
from tests.scenes import lambertian, ring

LIGHTS = np.concatenate([dome(12, 60.0), dome(8, 30.0)[:7]])


@pytest.fixture(scope="module")
def right() -> Capture:
    return noisy(lambertian(bumps(), LIGHTS))


def told(capture: Capture) -> list:
    return [f for f in check(capture) if f.kind in ("ambient", "encoding", "near", "halfway", "contrast")]


def changed(capture: Capture, images: np.ndarray) -> Capture:
    return replace(capture, images=images.astype(np.float32))


def near_lamps(widths: float) -> Capture:
    """A painted plate with shallow waves under lamps so many of its widths away, given by their directions."""
    size = 72
    y, x = np.mgrid[0.5 : -0.5 : 1j * size, -0.5 : 0.5 : 1j * size]
    z = 0.01 * np.sin(15 * x + 4 * y) * np.cos(11 * y)
    z_y, z_x = np.gradient(z, y[:, 0], x[0])
    N = normalised(np.stack([-z_x, -z_y, np.ones_like(z)], axis=-1))
    d = widths * LIGHTS[:, None, None] - np.stack([x, y, z], axis=-1)  # (n, h, w, 3)
    r = np.linalg.norm(d, axis=-1)
    paint = 0.4 + 0.1 * np.sin(9 * x) * np.sin(7 * y)
    I = paint * (widths / r) ** 2 * ((d / r[..., None]) * N).sum(-1).clip(0)
    return noisy(Capture(I[..., None].astype(np.float32), np.ones((size, size), bool), LIGHTS))


def test_nothing_is_told_of_a_right_capture(right):
    assert told(right) == []


@pytest.mark.parametrize("level", [0.1, 0.3, 0.7])
def test_ambient_light_is_told_at_any_strength(right, level):
    (found,) = told(changed(right, np.asarray(right.images) + level * right.mask[..., None]))
    assert found.kind == "ambient" and found.numbers["ambient_level"] == pytest.approx(level / 0.7, rel=0.15)


def test_on_one_ring_pictures_that_hardly_differ_are_told():
    """Under lamps of one height light that stays on is no other than a surface that faces the camera."""
    lights = ring(8, 45.0)[:8]
    capture = noisy(lambertian(bumps(), lights))
    assert told(capture) == []
    (found,) = told(changed(capture, np.asarray(capture.images) + 0.7 * capture.mask[..., None]))
    assert found.kind == "contrast" and "--dark" in found.message


def test_directions_halfway_to_the_lights_are_told_and_corrected(right):
    (found,) = told(replace(right, lights=normalised(LIGHTS + np.array([0, 0, 1]))))
    assert found.kind == "halfway" and angle_deg(found.lights, LIGHTS).max() < 1e-3


@pytest.mark.parametrize("widths", [1.5, 3.0])
def test_near_lamps_given_as_directions_are_told_with_their_distance(widths):
    (found,) = told(near_lamps(widths))
    assert found.kind == "near" and found.numbers["distance_widths"] == widths
    assert all(option in found.message for option in ("--mm-per-px", "--dome-radius-mm", "--flat FOLDER"))


def test_distant_lamps_are_not_near_ones():
    assert told(near_lamps(100.0)) == []
