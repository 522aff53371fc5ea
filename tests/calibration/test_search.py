"""Where mirror spheres are."""

import numpy as np
import pytest

from photonormal.calibration.choice import FoundCircle
from photonormal.calibration.circle import Circle, SphereError
from photonormal.calibration.mirror import directions
from photonormal.calibration.search import find_spheres
from photonormal.calibration.survey import Survey
from photonormal.geometry import angle_deg
from photonormal.types import InputError
from tests.calibration.chrome import CENTRE, RADIUS, SHAPE, dome, highlight_at, photograph
from tests.calibration.test_shadow import scene


def found(frames, count=1) -> list[FoundCircle]:
    """The spheres of grey pictures (h, w), or of coloured ones."""
    return find_spheres(lambda j: frames[j].reshape(*frames[j].shape[:2], -1), len(frames), "chrome", count)


def pictures(n=8, **how):
    return [photograph([(*highlight_at(l), 3.0)], seed=j, **how) / np.float32(255) for j, l in enumerate(dome(n))]


def test_a_sphere_is_found_to_a_fraction_of_a_pixel_and_surely():
    (sphere,) = found(pictures())
    circle = sphere.circle
    assert np.hypot(circle.x - CENTRE[0], circle.y - CENTRE[1]) < 0.3 and abs(circle.r - RADIUS) < 0.5
    assert circle.confidence > 0.8 > sphere.rival + 0.3


def test_a_larger_frame_scales_the_circle_and_nothing_else():
    import cv2

    large = [cv2.resize(p, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC) for p in pictures(4)]
    circle = found(large)[0].circle
    expected = 5 * np.array([CENTRE[0] + 0.5, CENTRE[1] + 0.5, RADIUS]) - [0.5, 0.5, 0]
    assert np.abs(np.array([circle.x, circle.y, circle.r]) - expected).max() < 2.5


def test_two_spheres_are_told_apart():
    both = []
    for j, l in enumerate(dome(6)):
        a = photograph([(*highlight_at(l, (80, 120), 60), 3.0)], (80, 120), 60, seed=j)
        b = photograph([(*highlight_at(l, (230, 110), 55), 3.0)], (230, 110), 55, seed=j)
        both.append(np.hstack([a[:, :155], b[:, 155:]]) / np.float32(255))
    left, right = sorted((f.circle for f in found(both, 2)), key=lambda c: c.x)
    assert [round(v) for v in (left.x, left.r, right.x, right.r)] == [80, 60, 230, 55]
    (best,) = found(both)
    assert round(best.circle.r) == 60 and "another ball that mirrors was seen in chrome" in best.notes[0]


def test_noise_and_stripes_are_no_sphere():
    rng = np.random.default_rng(0)
    stripes = np.tile((np.arange(320) % 40 < 20) * 0.5, (240, 1))
    with pytest.raises(InputError, match=r"no mirror sphere was found .* give --circle x,y,r"):
        found([(stripes + 0.02 * rng.random(SHAPE)).astype(np.float32) for _ in range(6)])


def cut_at(x: float) -> list[np.ndarray]:
    """A sphere of 90 pixels of radius whose centre is x pixels from the left border."""
    lights = enumerate(dome(5, 40))
    frames = [photograph([(*highlight_at(l, (x, 120), 90), 3.0)], (x, 120), 90, seed=j) for j, l in lights]
    return [frame / np.float32(255) for frame in frames]


def test_a_sphere_of_which_the_border_cuts_off_most_is_refused():
    with pytest.raises(SphereError, match=r"the sphere in chrome at \d.* is cut by the border") as refusal:
        found(cut_at(40))
    assert round(refusal.value.circles[0].r) == 90


def test_a_sphere_that_the_border_cuts_a_little_is_used():
    circle = found(cut_at(70))[0].circle
    assert np.abs(np.array([circle.x, circle.y, circle.r]) - (70, 120, 90)).max() < 0.5 and circle.cut(SHAPE)


def test_a_sphere_of_which_the_border_hides_highlights_is_to_be_photographed_whole():
    half = [
        photograph([(*highlight_at(l, (20, 120), 60), 3.0)], (20, 120), 60, seed=j) for j, l in enumerate(dome(8, 80))
    ]
    with pytest.raises(SphereError, match=r"at 2\d\.\d,1[12]\d\.\d,[56]\d\.\d .*border.* photograph"):
        found([p / np.float32(255) for p in half])


def table(lights, ball=(250.0, 120.0), r=25.0, horizon=False, coin=False) -> list[np.ndarray]:
    """A matt table under distant lights, on it a mirror ball, with its horizon in it, and a coin with a relief."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    rng, made = np.random.default_rng(0), []
    away, beside = np.hypot(x - ball[0], y - ball[1]), np.hypot(x - 90, y - 110)
    slopes = 0.5 * rng.standard_normal((2, *SHAPE))
    for light in lights:
        ground = np.full(SHAPE, 0.5 * light[2])
        if coin:
            ground = np.where(
                beside < 55, 0.7 * (light[2] + slopes[0] * light[0] + slopes[1] * light[1]).clip(0), ground
            )
        rim = 0.25 * light[2] * (away > r / np.sqrt(2)) if horizon else 0.0
        picture = np.where(away < r, 0.02 + rim, ground)
        sx, sy = highlight_at(light, ball, r)
        picture = picture + 2 * np.exp(-((x - sx) ** 2 + (y - sy) ** 2) / 1.5**2)
        made.append((picture + 0.004 * rng.standard_normal(SHAPE)).clip(0, 1).astype(np.float32))
    return made


@pytest.mark.parametrize("scene", [{}, {"coin": True}, {"horizon": True}, {"r": 12.0, "coin": True}])
def test_the_ball_is_what_mirrors_and_its_outline_the_outermost_circle(scene):
    (sphere,) = found(table(dome(10, 80), **scene))
    c, r = sphere.circle, scene.get("r", 25.0)
    assert np.hypot(c.x - 250, c.y - 120) < 0.5 and abs(c.r - r) < 0.4 and sphere.notes == ()


def test_a_coin_alone_is_no_sphere():
    with pytest.raises(SphereError, match="no mirror sphere was found in chrome"):
        found([p[:, :200] for p in table(dome(10, 80), coin=True)])


def test_shadows_lead_to_a_small_ball_where_no_highlights_do(monkeypatch):
    monkeypatch.setattr(Survey, "constellations", lambda _: [])
    ball, lights = Circle(262.0, 120.0, 6.0), dome(12, 70)[4:]
    (sphere,) = found(scene(lights, ball=ball))
    assert np.hypot(sphere.circle.x - ball.x, sphere.circle.y - ball.y) < 0.3 and abs(sphere.circle.r - ball.r) < 0.5
    L, _ = directions(sphere.circle, sphere.xy)
    assert angle_deg(L, lights).mean() < 5
