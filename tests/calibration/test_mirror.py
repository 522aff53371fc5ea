"""Reflection on a sphere: highlights, directions, positions."""

import numpy as np
import pytest
from scipy.optimize import minimize

from photonormal.calibration.circle import Circle, SphereError
from photonormal.calibration.highlight import check_number, check_sizes, darkest_channel, looked_for
from photonormal.calibration.mirror import directions, nearest_point, sphere_centre
from photonormal.calibration.sphere import Sphere
from photonormal.geometry import angle_deg, normalised
from photonormal.types import InputError
from tests.calibration.chrome import CENTRE, RADIUS, SHAPE, dome, highlight_at, photograph

CIRCLE = Circle(*CENTRE, RADIUS)


def seen(spots, **how):
    return in_picture(photograph(spots, **how) / np.float32(255))


def in_picture(picture):
    return looked_for(picture[None], CIRCLE)[0]


@pytest.mark.parametrize("width", [1.2, 3.0, 8.0])
def test_a_highlight_is_found_to_a_tenth_of_a_pixel(width):
    spot = seen([(140.3, 100.7, width)])
    assert spot.saturated == (width > 2) and np.hypot(spot.x - 140.3, spot.y - 100.7) < 0.1 * max(1, width / 3)


def test_a_highlight_between_a_dark_room_and_a_bright_table_is_not_pulled_to_the_room():
    circle = Circle(20.2, 19.7, 11.0)
    y, x = np.mgrid[:41, :41].astype(float)
    away = np.hypot(x - circle.x, y - circle.y) / circle.r
    mirrored = 0.01 + 0.3 * ((away - 0.68) * circle.r / 2).clip(0, 1)
    phi = np.pi * np.arange(8) / 4 + 0.2
    at = circle.x + 0.6 * circle.r * np.cos(phi), circle.y + 0.6 * circle.r * np.sin(phi)
    light = [mirrored + 0.15 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 2) for a, b in zip(*at, strict=True)]
    found = looked_for((np.stack(light) ** (1 / 2.2)).astype(np.float32), circle)
    assert max(np.hypot(h.x - a, h.y - b) for h, a, b in zip(found, *at, strict=True)) < 0.12


def test_a_small_sphere_is_doubted():
    def doubts(r: float) -> list[str]:
        return Sphere("balls", Circle(50, 50, r), 0.0, (), np.empty((0, 3)), np.empty((0, 3)), (100, 100)).doubts([])

    assert doubts(20) == [] and "only 10 pixels in radius, so that half a pixel turns a light by 6" in doubts(10)[0]


def test_of_two_reflections_the_stronger_is_the_light():
    spot = seen([(180.0, 140.0, 2.5), (140.0, 100.0, 6.0)])
    assert (round(spot.x), round(spot.y)) == (140, 100) and not spot.rivals


def test_two_equal_reflections_are_reported():
    spot = seen([(180.0, 140.0, 4.0), (140.0, 100.0, 4.2)])
    left, right = sorted([(h.x, h.y) for h in (spot, *spot.rivals)])
    assert np.abs(np.subtract([left, right], [(140, 100), (180, 140)])).max() < 0.1


def test_a_lamp_that_stays_on_is_no_light():
    window = (120.0, 90.0, 6.0)
    pictures = np.stack([photograph([window, (*highlight_at(l), 3.0)], seed=j) for j, l in enumerate(dome(6))]) / 255
    for spot, light in zip(looked_for(pictures.astype(np.float32), CIRCLE), dome(6), strict=True):
        assert np.hypot(*(np.array([spot.x, spot.y]) - highlight_at(light))) < 1


def test_a_streak_does_not_pull_the_centroid():
    streak = [(140.0 + 0.7 * k, 100.0 + 2.0 * k, 1.0) for k in range(1, 20)]
    spot = seen([(140.0, 100.0, 6.0), *streak])
    assert np.hypot(spot.x - 140, spot.y - 100) < 0.8


def test_bright_spots_outside_the_sphere_are_not_looked_at():
    spot = seen([(300.0, 20.0, 9.0), (140.0, 100.0, 3.0)])
    assert np.hypot(spot.x - 140, spot.y - 100) < 0.2


def shown(lights) -> list:
    return looked_for(np.stack([photograph(spots, seed=7) / np.float32(255) for spots in lights]), CIRCLE)


def test_a_light_behind_the_sphere_leaves_no_highlight():
    found = shown([[(*highlight_at(l), 3.0)] for l in dome(5)] + [[]])
    assert [h is None for h in found] == [False] * 5 + [True]
    check_number(found, list("abcdef"), CIRCLE, "chrome")  # one of six may be missing
    with pytest.raises(
        SphereError, match=r"no highlight was found on the sphere at 150.3,117.6,81.4 .* in 2 of 6 .*--skip"
    ):
        check_number([*found[:4], None, None], list("abcdef"), CIRCLE, "chrome")


def test_a_matt_sphere_is_refused():
    broad = shown([[(140.0 + 2 * k, 100.0, 45.0)] for k in range(3)])
    with pytest.raises(SphereError, match=r"covers \d+ % of the sphere at .* use a mirror sphere"):
        check_sizes(broad, list("abc"), CIRCLE, "chrome")


def test_a_bright_table_in_the_sphere_is_no_highlight():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    table = np.hypot(x - CENTRE[0], y - CENTRE[1]) > 0.71 * RADIUS
    dim = photograph([(140.0, 100.0, 2.0)]) / np.float32(255) * 0.5
    spot = in_picture(np.where(table, np.float32(0.3), dim))
    assert np.hypot(spot.x - 140, spot.y - 100) < 0.2


def test_the_highlight_on_a_red_ball_is_seen_in_its_darkest_channel():
    white = photograph([(140.0, 100.0, 3.0)], sphere=0.0) / np.float32(255)
    red = np.stack([np.maximum(white, 0.8), white, white], axis=-1)
    spot = in_picture(darkest_channel(red))
    assert np.hypot(spot.x - 140, spot.y - 100) < 0.2


def test_a_faint_glint_on_a_shaded_body_is_the_light():
    """The body is three times as bright as the glint, whose width is a pixel's."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    u, v = (x - 150.3) / 23, (117.6 - y) / 23
    z = np.sqrt((1 - u**2 - v**2).clip(0))
    lights, pictures, rng = dome(8, 70), [], np.random.default_rng(0)
    for light in lights:
        sx, sy = highlight_at(light, CENTRE, 23)
        body = 0.3 * (light @ np.stack([u, v, z]).reshape(3, -1)).clip(0).reshape(SHAPE) * (z > 0)
        glint = 0.1 * np.exp(-((x - sx) ** 2 + (y - sy) ** 2) / 2)
        pictures.append(body + glint + 0.005 * rng.standard_normal(SHAPE))
    found = looked_for(np.stack(pictures).astype(np.float32), Circle(*CENTRE, 23.0))
    off = [np.hypot(*(np.array([h.x, h.y]) - highlight_at(l, CENTRE, 23))) for h, l in zip(found, lights, strict=True)]
    assert np.median(off) < 0.2 and max(off) < 0.6


def test_a_reflection_that_glare_has_spread_is_left_out():
    spots = [[(*highlight_at(l), 3.0)] for l in dome(5)] + [[(140.0, 100.0, 3.0), (140.0, 100.0, 45.0)]]
    assert [h is None for h in shown(spots)] == [False] * 5 + [True]


def test_a_channel_that_no_lamp_lights_is_not_asked():
    red = np.stack([photograph([(140.0, 100.0, 3.0)]), np.zeros(SHAPE), np.zeros(SHAPE)], axis=-1) / 255
    assert darkest_channel(red).max() == red.max()


def test_directions_obey_the_law_of_reflection():
    lights = dome(40, widest_deg=150)
    L, N = directions(CIRCLE, np.array([highlight_at(l) for l in lights]))
    assert angle_deg(L, lights).max() < 1e-5
    assert (
        angle_deg(normalised(L + np.array([0, 0, 1])), N).max() < 1e-5
    )  # the normal halves light and view: it is not the light


def reflected(light, centre, radius):
    """The point of a sphere that reflects a light to a camera at the origin: the shortest way (Fermat)."""

    def point(angles):
        t, p = angles
        return centre + radius * np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])

    def way(angles):
        return np.linalg.norm(point(angles)) + np.linalg.norm(light - point(angles))

    best = min(
        (
            minimize(way, (0.4, p), method="Nelder-Mead", options={"xatol": 1e-12, "fatol": 1e-14})
            for p in (0.0, 1.6, 3.1, 4.7)
        ),
        key=lambda s: s.fun,
    )
    return point(best.x)


def cone_outline(centre, radius, focal):
    """Mean circle of a sphere's outline in the picture, by projecting the circle where rays touch the sphere."""
    d = np.linalg.norm(centre)
    axis = centre / d
    a = normalised(np.cross(axis, [0.0, 1.0, 0.0]))
    b = np.cross(axis, a)
    phi = np.linspace(0, 2 * np.pi, 360, endpoint=False)[:, None]
    ring = centre * (1 - (radius / d) ** 2) + radius * np.sqrt(1 - (radius / d) ** 2) * (
        np.cos(phi) * a + np.sin(phi) * b
    )
    return project(ring, focal)


def project(points, focal):
    points = np.atleast_2d(points)
    return np.column_stack([focal * points[:, 0] / -points[:, 2], -focal * points[:, 1] / -points[:, 2]])


@pytest.mark.parametrize("centre", [(0.0, 0.0, -300.0), (40.0, -30.0, -300.0)])
def test_perspective_directions_and_positions(centre):
    from photonormal.calibration.circle import fit_circle

    focal, radius, centre = 2000.0, 20.0, np.array(centre)
    lights = np.array([[150.0, 80, -100], [-200, 50, 0], [30, -120, -150], [0, 0, 50.0]])
    points = np.stack([reflected(l, centre, radius) for l in lights])
    circle = Circle(*fit_circle(cone_outline(centre, radius, focal))[:3])
    assert np.linalg.norm(radius * sphere_centre(circle, focal, (0, 0)) - centre) < 1.5  # mm of 300
    L, P = directions(circle, project(points, focal), focal)
    assert angle_deg(L, normalised(lights - points)).max() < 0.5
    assert np.abs(radius * P - points).max() < 1.5
    flat, _ = directions(circle, project(points, focal))  # as if the camera were far away
    assert angle_deg(L, normalised(lights - points)).max() < angle_deg(flat, normalised(lights - points)).max()


def test_lines_to_one_light_meet_there():
    light = np.array([30.0, -50, 200])
    points = np.array([[0.0, 0, 0], [100, 0, 0], [0, 80, 10]])
    x, miss = nearest_point(points, normalised(light - points))
    assert np.abs(x - light).max() < 1e-9 and miss < 1e-9


def test_a_light_at_infinity_has_no_position():
    with pytest.raises(InputError, match="position can't be found"):
        nearest_point(np.array([[0.0, 0, 0], [100, 0, 0]]), np.array([[0, 0, 1.0], [0, 0, 1]]))


def test_a_small_highlight_beside_a_table_that_darkens_with_its_lamp_is_not_pulled_aside():
    circle = Circle(20.2, 19.7, 11.0)
    y, x = np.mgrid[:41, :41].astype(float)
    away = np.hypot(x - circle.x, y - circle.y) / circle.r
    table = 0.3 / (1 + np.exp(-(away - 0.75) * circle.r / 0.6))
    phi = np.pi * np.arange(9) / 4.5 + 0.2
    zenith = np.where(np.arange(9) < 4, 76, 40)  # the low lamps light the table less
    at = [circle.x + circle.r * np.sin(np.radians(zenith / 2)) * np.cos(phi)]
    at += [circle.y + circle.r * np.sin(np.radians(zenith / 2)) * np.sin(phi)]
    light = [
        0.005 + table * np.cos(np.radians(z)) + 0.15 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 2)
        for a, b, z in zip(*at, zenith, strict=True)
    ]
    found = looked_for((np.stack(light) ** (1 / 2.2)).astype(np.float32), circle)
    assert max(np.hypot(h.x - a, h.y - b) for h, a, b in zip(found, *at, strict=True)) < 0.1
