"""Circles around points and masks."""

import numpy as np
import pytest

from photonormal.calibration.circle import Circle, fit_circle, from_mask
from photonormal.types import InputError
from tests.calibration.chrome import CENTRE, RADIUS, SHAPE


def test_a_mask_gives_its_circle_even_with_a_stand():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    mask = (x - CENTRE[0]) ** 2 + (y - CENTRE[1]) ** 2 < RADIUS**2
    mask |= (np.abs(x - CENTRE[0]) < 18) & (y > CENTRE[1]) & (y < CENTRE[1] + RADIUS + 25)
    circle = from_mask(mask, "chrome")
    assert np.hypot(circle.x - CENTRE[0], circle.y - CENTRE[1]) < 0.3 and abs(circle.r - RADIUS) < 0.3


@pytest.mark.parametrize(
    ("mask", "says"),
    [
        (np.zeros((40, 40), bool), "is empty"),
        (np.ones((40, 40), bool), "fills the frame"),
        (np.pad(np.ones((10, 120), bool), 20), "is no circle"),
    ],
)
def test_masks_that_are_no_sphere_are_refused(mask, says):
    with pytest.raises(InputError, match=says):
        from_mask(mask, "chrome")


def test_a_fit_holds_with_a_third_of_the_points_astray():
    rng = np.random.default_rng(0)
    phi = rng.uniform(0, 2 * np.pi, 300)
    points = np.stack([50 + 30 * np.cos(phi), 40 + 30 * np.sin(phi)], axis=-1)
    points[:100] = rng.uniform(0, 90, (100, 2))
    assert np.abs(np.array(fit_circle(points)[:3]) - [50, 40, 30]).max() < 0.05


def test_inside_counts_the_disc():
    assert Circle(50, 50, 20).inside((100, 100)).sum() == pytest.approx(np.pi * 400, rel=0.01)
