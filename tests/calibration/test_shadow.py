"""Circles and the shadows around them: the shadow that a sphere casts is an ellipse, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from photonormal.calibration.circle import Circle
from photonormal.calibration.search import find_spheres
from photonormal.calibration.shadow import Surroundings, shadows
from photonormal.calibration.sphere import look_at_spheres
from photonormal.geometry import normalised
from tests.calibration.chrome import SHAPE, dome, highlight_at

BALL, UP = Circle(150.0, 120.0, 20.0), np.array([0.0, 0.0, 1.0])


def scene(lights, base=0.0, wrong=(), ball=BALL) -> list[np.ndarray]:
    """A black ball on a white table, in front of it its shadows, below it a darker round base of that radius.

    The highlights of `wrong` pictures lie opposite.
    """
    y, x = (a.ravel() for a in np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float))
    rng, away, made = np.random.default_rng(0), np.hypot(x - ball.x, y - ball.y), []
    dark = shadows(ball, lights, UP, x, y)
    for j, (light, shaded) in enumerate(zip(lights, dark, strict=True)):
        table = np.where(away < base, 0.3, 0.7) * (0.03 + light[2] * ~shaded)
        sx, sy = highlight_at(light * [-1, -1, 1] if j in wrong else light, (ball.x, ball.y), ball.r)
        picture = np.where(away < ball.r, 0.02, table) + 2 * np.exp(-((x - sx) ** 2 + (y - sy) ** 2) / 1.5**2)
        made.append((picture + 0.004 * rng.standard_normal(picture.shape)).clip(0, 1).reshape(SHAPE).astype(np.float32))
    return made


def highlights(lights) -> np.ndarray:
    return np.array([highlight_at(light, (BALL.x, BALL.y), BALL.r) for light in lights])


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 60.0])
def test_a_shadow_is_an_ellipse_behind_the_ball(tilt_deg):
    """On the plane z = -r its middle lies at -r tan(tilt), its long half axis is r / cos(tilt), its short one r."""
    light = np.array([[np.sin(np.radians(tilt_deg)), 0.0, np.cos(np.radians(tilt_deg))]])
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    dark = shadows(BALL, light, UP, x.ravel(), y.ravel()).reshape(SHAPE)
    along = (x - BALL.x + BALL.r * np.tan(np.radians(tilt_deg))) * np.cos(np.radians(tilt_deg))
    assert (dark == (np.hypot(along, y - BALL.y) < BALL.r)).mean() > 0.999


def test_near_lamps_cast_larger_shadows_than_distant_ones():
    y, x = (a.ravel() for a in np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float))
    overhead = np.array([[0.0, 0.0, 1.0]])
    distant, near = (shadows(BALL, overhead, UP, x, y, part).sum() for part in (0.0, 0.25))
    radius = 5 * np.tan(np.arcsin(1 / 4))  # of the cone from a lamp 4 radii above the centre, on a plane 5 below it
    assert near / distant == pytest.approx(radius**2, rel=0.02)


def test_the_ball_s_circle_explains_what_is_dark_and_others_do_not():
    lights = dome(12, 70)
    around = Surroundings.of([np.sqrt(p) for p in scene(lights)])
    xy = highlights(lights)
    assert around.explained(BALL, xy) > 0.95
    assert max(around.explained(Circle(150, 120, 20 * part), xy) for part in (0.75, 1.4)) < 0.8


def test_of_two_reflections_the_shadow_tells_which_is_the_light_s():
    lights = dome(12, 70)[6:]
    around, right = Surroundings.of([np.sqrt(p) for p in scene(lights)]), highlights(lights)
    other = 2 * np.array([BALL.x, BALL.y]) - right  # opposite
    xy, others = right.copy(), np.full((1, *right.shape), np.nan)
    xy[2], others[0, 2], others[0, 4] = other[2], right[2], other[4]
    chosen, clear = around.chosen(BALL, xy, others)
    assert np.allclose(chosen, right) and clear[[2, 4]].all()


def test_lamps_are_as_near_as_the_gradients_of_their_light_say():
    """Lamps 12 radii from the ball's centre light a table with T.(p - x) / |p - x|^3, and cast larger shadows."""
    lights, r, far = dome(12, 60), BALL.r, 12 * BALL.r
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    dark = shadows(BALL, lights, UP, x.ravel(), y.ravel(), near=1 / 12).reshape(-1, *SHAPE)
    frames = []
    for light, shaded in zip(lights, dark, strict=True):
        X, Y, Z = (far * light)[:, None, None] - np.stack([x - BALL.x, BALL.y - y, np.full(SHAPE, -r)])
        table = 0.3 * far**2 * Z / (X**2 + Y**2 + Z**2) ** 1.5
        frames.append(np.where(np.hypot(x - BALL.x, y - BALL.y) < r, 0.02, table * (0.03 + ~shaded)).clip(0, 1))
    around = Surroundings.of([np.sqrt(p).astype(np.float32) for p in frames])
    seen = lights
    for _ in range(20):  # from where on the ball they are mirrored
        seen = normalised(12 * lights - normalised(seen + UP))
    xy = highlights(seen)
    assert around.explained(BALL, xy) > 0.95
    found = around.fitted(Circle(152, 119, 22), xy)
    assert np.hypot(found.x - 150, found.y - 120) < 0.4 and abs(found.r - 20) < 0.6


def test_shadows_lead_to_the_circle():
    lights = dome(12, 70)
    around = Surroundings.of([np.sqrt(p) for p in scene(lights)])
    found = around.fitted(Circle(152, 119, 23), highlights(lights))
    assert np.hypot(found.x - 150, found.y - 120) < 0.3 and abs(found.r - 20) < 0.4


def test_a_picture_whose_highlight_is_another_thing_s_stands_out():
    lights = dome(12, 70)
    around = Surroundings.of([np.sqrt(p) for p in scene(lights)])
    xy = highlights(lights)
    xy[7] = 2 * np.array([150.0, 120]) - xy[7]
    each = around.of_each(BALL, xy)
    assert np.nanargmin(each) == 7 and each[7] < 0.3 < 0.8 < np.nanmedian(each)
    assert around.explained(BALL, xy) > 0.95


def test_the_rim_of_a_base_is_not_the_ball_s():
    frames = scene(dome(12, 70), base=30.0)
    (sphere,) = find_spheres(lambda j: frames[j][..., None], len(frames), "chrome")
    assert np.hypot(sphere.circle.x - 150, sphere.circle.y - 120) < 0.5 and abs(sphere.circle.r - 20) < 0.4
    assert sphere.notes == ()


def test_a_light_whose_highlight_was_another_thing_s_is_left_out_and_named():
    frames = scene(dome(12, 70), wrong=(7,))
    names = [f"{j}.png" for j in range(12)]
    (sphere,) = look_at_spheres(lambda j: frames[j][..., None], SHAPE, names, "chrome")
    assert sphere.astray == (7,) and np.flatnonzero(np.isnan(sphere.L[:, 0])).tolist() == [7]
    assert [line for line in sphere.doubts(names) if "7.png" in line and "left out" in line] == sphere.doubts(names)
