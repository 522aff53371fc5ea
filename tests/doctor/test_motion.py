"""Pictures that moved are found with their shifts, and none where a pattern repeats."""

import numpy as np
import pytest

from photonormal.doctor.motion import motion, shifts
from photonormal.geometry import normalised
from tests.calibration.chrome import dome
from tests.doctor.test_explanations import shining
from tests.scenes import sphere

LIGHTS = np.concatenate([dome(12, 60.0), dome(8, 30.0)[:7]])
SHINE = 20  # exponent of the highlights


def shiny(z: np.ndarray) -> np.ndarray:
    """Pictures (n, h, w) of a relief with highlights, and a little noise."""
    z_y, z_x = np.gradient(z)
    N = normalised(np.stack([-z_x, z_y, np.ones_like(z)], axis=-1))
    half = normalised(LIGHTS + np.array([0, 0, 1]))
    I = (N @ LIGHTS.T).clip(0) + 0.5 * (N @ half.T).clip(0) ** SHINE
    return I.transpose(2, 0, 1) + 0.01 * np.random.default_rng(0).standard_normal((len(LIGHTS), *z.shape))


@pytest.fixture(scope="module")
def rough() -> np.ndarray:
    import cv2

    z = cv2.GaussianBlur(np.random.default_rng(1).standard_normal((90, 110)), (0, 0), 2.5)
    return shiny(8 * z)


@pytest.fixture(scope="module")
def woven() -> np.ndarray:
    y, x = np.mgrid[:90, :110].astype(float)
    return shiny(1.5 * np.sin(0.9 * x) * np.sin(0.9 * y))


def test_pictures_that_lie_where_the_others_do_have_not_moved(rough, woven):
    assert not shifts(rough).any() and not shifts(woven).any()


@pytest.mark.parametrize("moved", [{4: (5, -2)}, {0: (1, 3), 7: (-3, 0), 11: (-4, -4)}])
def test_shifts_are_found_and_others_are_left_alone(rough, moved):
    images = rough.copy()
    for j, (x, y) in moved.items():
        images[j] = np.roll(images[j], (y, x), axis=(0, 1))
    found = shifts(images)
    assert np.flatnonzero(found.any(1)).tolist() == sorted(moved)
    assert all(np.abs(found[j] - s).max() < 0.5 for j, s in moved.items())


@pytest.mark.parametrize("group", [slice(10, None), slice(None, 8), slice(None, None, 2)])
def test_many_pictures_shifted_alike_are_told_against_the_others(rough, group):
    """As after a camera was touched: no picture moved against most of the others."""
    images = rough.copy()
    images[group] = np.roll(images[group], (3, -2), axis=(1, 2))
    moved = np.zeros(len(images), bool)
    moved[group] = True
    sign = 1 if 2 * moved.sum() < len(images) else -1  # of more than half the others are named
    named = moved if sign == 1 else ~moved
    found = shifts(images)
    assert (found.any(1) == named).all() and np.abs(found[named] - sign * np.array([-2, 3])).max() < 0.5


def test_pictures_shifted_alike_are_told_to_parts_of_a_pixel(rough):
    """Pixels here are many of a large photograph's."""
    from scipy.ndimage import shift

    images, moved = rough.copy(), np.arange(len(rough)) >= 12
    images[moved] = shift(images[moved], (0, 2.6, -1.6), mode="wrap")
    found = shifts(images)
    assert (found.any(1) == moved).all() and np.abs(found[moved] - [-1.6, 2.6]).max() < 0.2


def test_pictures_shifted_alike_are_named_together(rough):
    images = rough.copy()
    images[12:] = np.roll(images[12:], (0, 4), axis=(1, 2))
    images[3] = np.roll(images[3], (-5, 0), axis=(0, 1))
    (found,) = motion(images, 0.5, [f"{j}.png" for j in range(len(images))])
    assert "8 pictures are shifted" in found.message and found.grave
    assert "3.png by (+0.0, -10.0) px, 12.png to 18.png by (+8.0, +0.0) px;" in found.message


def test_what_moves_by_itself_is_no_picture_that_moved():
    """As a highlight does: most of the detail lies elsewhere in one picture, but most of the picture does not."""
    import cv2

    z = cv2.GaussianBlur(np.random.default_rng(1).standard_normal((90, 110)), (0, 0), 2.5)
    z[30:60, 40:75] *= 12
    images = shiny(z)
    images[4, 30:60, 40:75] = np.roll(images[4], (3, 4), axis=(0, 1))[30:60, 40:75]
    assert not shifts(images).any()
    images[4] = np.roll(shiny(z)[4], (3, 4), axis=(0, 1))
    assert np.abs(shifts(images)[4] - (4, 3)).max() < 0.5


@pytest.mark.parametrize(("lights", "exponent"), [(12, 50), (14, 150)])
def test_highlights_of_a_ball_are_no_pictures_that_moved_together(lights, exponent):
    """A highlight that is shifted lies where another picture has one."""
    capture = shining(sphere(72), 2.0, exponent, dome(lights, 65.0))
    assert not shifts(np.asarray(capture.images)[..., 0]).any()


def test_what_repeats_is_not_said_to_have_moved_by_a_repeat(woven):
    """A shift by whole threads can't be seen in them."""
    images = woven.copy()
    images[3] = np.roll(images[3], 7, axis=1)
    assert not shifts(images).any()
