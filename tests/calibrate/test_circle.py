"""Where a mirror sphere is."""

import numpy as np
import pytest

from photonormal.calibrate.circle import Circle, find_circles, fit_circle, from_mask
from photonormal.types import InputError
from tests.calibrate.chrome import CENTRE, RADIUS, SHAPE, dome, highlight_at, photograph


def pictures(n=8, **how):
    return [photograph([(*highlight_at(l), 3.0)], seed=j, **how) / np.float32(255) for j, l in enumerate(dome(n))]


def test_a_sphere_is_found_to_a_fraction_of_a_pixel_and_surely():
    ((circle, elsewhere),) = find_circles(pictures(), "chrome")
    assert np.hypot(circle.x - CENTRE[0], circle.y - CENTRE[1]) < 0.3 and abs(circle.r - RADIUS) < 0.5
    assert circle.confidence > 0.8 > elsewhere + 0.3


def test_a_larger_frame_scales_the_circle_and_nothing_else():
    import cv2

    large = [cv2.resize(p, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC) for p in pictures(4)]
    ((circle, _),) = find_circles(large, "chrome")
    expected = 5 * np.array([CENTRE[0] + 0.5, CENTRE[1] + 0.5, RADIUS]) - [0.5, 0.5, 0]
    assert np.abs(np.array([circle.x, circle.y, circle.r]) - expected).max() < 2.5


def test_two_spheres_are_told_apart():
    both = []
    for j, l in enumerate(dome(6)):
        a = photograph([(*highlight_at(l, (80, 120), 60), 3.0)], (80, 120), 60, seed=j)
        b = photograph([(*highlight_at(l, (230, 110), 55), 3.0)], (230, 110), 55, seed=j)
        both.append(np.hstack([a[:, :155], b[:, 155:]]) / np.float32(255))
    found = sorted((c for c, _ in find_circles(both, "chrome", spheres=2)), key=lambda c: c.x)
    assert [round(c.x) for c in found] == [80, 230] and [round(c.r) for c in found] == [60, 55]


def test_noise_and_stripes_are_no_sphere():
    rng = np.random.default_rng(0)
    stripes = np.tile((np.arange(320) % 40 < 20) * 0.5, (240, 1))
    with pytest.raises(InputError, match=r"0 of 1 mirror spheres were found .* give --circle x,y,r"):
        find_circles([(stripes + 0.02 * rng.random(SHAPE)).astype(np.float32) for _ in range(6)], "stripes")


def test_a_sphere_cut_by_the_border_is_refused():
    cut = [photograph([(60.0, 110.0, 3.0)], (70, 120), 90, seed=j) / np.float32(255) for j in range(5)]
    with pytest.raises(InputError, match="is cut by the border"):
        find_circles(cut, "chrome")


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
