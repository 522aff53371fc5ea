"""The radius of a sphere whose rim mirrors what lies right behind it."""

import cv2
import numpy as np
import pytest

from photonormal.calibration.circle import Circle
from photonormal.calibration.rim import faded

X, Y, R = 120.3, 99.6, 70.0


def ball(f0: float, body: float = 0.0, shadow: bool = False, r: float = R) -> np.ndarray:
    """Light (200, 240) of a sphere that mirrors by `f0` at right angles and scatters `body`, on a ground, blurred."""
    offset = (np.arange(8) + 0.5) / 8 - 0.5
    x = (np.arange(240)[:, None] + offset).ravel() - X
    y = (np.arange(200)[:, None] + offset).ravel() - Y
    rho = np.hypot(x[None], y[:, None]) / r
    ground = 0.4 + 0.1 * x[None] / 120 + 0 * y[:, None]
    if shadow:  # across a third of the outline
        ground = np.where(y[:, None] > 0.5 * r, 0.3 * ground, ground)
    inside = body + (f0 + (1 - f0) * (1 - np.sqrt(1 - rho.clip(0, 1) ** 2)) ** 5) * ground
    fine = np.where(rho < 1, inside, ground)
    picture = cv2.GaussianBlur(fine.reshape(200, 8, 240, 8).mean((1, 3)), (0, 0), 0.8)
    return (picture + 0.002 * np.random.default_rng(0).standard_normal(picture.shape)).astype(np.float32)


@pytest.mark.parametrize("start", [0.985, 0.995])
@pytest.mark.parametrize("sphere", [{"f0": 0.045}, {"f0": 0.7}, {"f0": 0.045, "body": 0.1}])
@pytest.mark.parametrize("shadow", [False, True])
def test_the_radius_is_where_the_surroundings_begin(start, sphere, shadow):
    found = faded(ball(**sphere, shadow=shadow), Circle(X, Y, start * R, 0.8))
    assert abs(found.r - R) < 0.006 * R and (found.x, found.y, found.confidence) == (X, Y, 0.8)


def test_a_rim_that_does_not_mirror_is_a_step():
    y, x = np.mgrid[:200, :240]
    disc = 0.4 - 0.35 * (R + 0.5 - np.hypot(x - X, y - Y)).clip(0, 1)
    found = faded(cv2.GaussianBlur(disc.astype(np.float32), (0, 0), 0.8), Circle(X, Y, 0.99 * R))
    assert abs(found.r - R) < 0.3


def test_a_small_sphere_s_centre_is_found_with_its_radius():
    found = faded(ball(0.045, r=16.0), Circle(X + 0.5, Y - 0.4, 15.5))
    assert np.hypot(found.x - X, found.y - Y) < 0.05 and abs(found.r - 16) < 0.15


def test_a_circle_is_not_moved_inwards_onto_something_else():
    given = Circle(X, Y, R + 2.0, 0.8)
    assert faded(ball(0.045), given) == given
