"""What explains pictures that their lights don't: the right explanation is told, and none where nothing is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from photonormal.doctor import findings_of, samples
from photonormal.doctor.explanations import explanation, raised
from photonormal.doctor.given import Distant
from photonormal.geometry import angle_deg, normalised
from photonormal.types import Capture, Normals
from tests.calibration.chrome import dome
from tests.doctor.test_check import bumps, noisy
from tests.scenes import lambertian, ring, sphere

LIGHTS = np.concatenate([dome(12, 60.0), dome(8, 30.0)[:7]])


@pytest.fixture(scope="module")
def right() -> Capture:
    return noisy(lambertian(bumps(), LIGHTS))


def told(capture: Capture) -> list:
    return [f for f in findings_of(capture) if f.kind in ("ambient", "encoding", "near", "halfway", "contrast")]


def changed(capture: Capture, images: np.ndarray) -> Capture:
    return replace(capture, images=images.astype(np.float32))


def near_lamps(widths: float, sheen: float = 0.0) -> Capture:
    """A painted plate with shallow waves under lamps so many of its widths away, given by their directions; `sheen` is
    the level of a highlight."""
    size = 72
    y, x = np.mgrid[0.5 : -0.5 : 1j * size, -0.5 : 0.5 : 1j * size]
    z = 0.01 * np.sin(15 * x + 4 * y) * np.cos(11 * y)
    z_y, z_x = np.gradient(z, y[:, 0], x[0])
    N = normalised(np.stack([-z_x, -z_y, np.ones_like(z)], axis=-1))
    d = widths * LIGHTS[:, None, None] - np.stack([x, y, z], axis=-1)  # (n, h, w, 3)
    r = np.linalg.norm(d, axis=-1)
    paint = 0.4 + 0.1 * np.sin(9 * x) * np.sin(7 * y)
    L = d / r[..., None]
    shown = paint * (L * N).sum(-1).clip(0) + sheen * (normalised(L + np.array([0, 0, 1])) * N).sum(-1).clip(0) ** 60
    I = (widths / r) ** 2 * shown
    return noisy(Capture(I[..., None].astype(np.float32), np.ones((size, size), bool), LIGHTS))


def test_nothing_is_told_of_a_right_capture(right):
    assert told(right) == []


@pytest.mark.parametrize("level", [0.1, 0.3, 0.7])
def test_ambient_light_is_told_at_any_strength(right, level):
    (found,) = told(changed(right, np.asarray(right.images) + level * right.mask[..., None]))
    assert found.kind == "ambient" and found.numbers["ambient_level"] == pytest.approx(level / 0.7, rel=0.15)


@pytest.mark.parametrize(("exponent", "says"), [(2.2, "look sRGB-encoded"), (1.8, "gamma of 1.8")])
def test_an_encoding_is_told_from_light_that_stays_on(right, exponent, says):
    s = samples.read(right)
    (found,) = explanation(Distant(s.I ** (1 / exponent), LIGHTS), s.mask, 16, linearised=False)
    assert found.kind == "encoding" and says in found.message
    (found,) = explanation(Distant(s.I + 0.5 * s.I.mean(1, keepdims=True), LIGHTS), s.mask, 16, linearised=False)
    assert found.kind == "ambient"


def test_pictures_that_hardly_differ_are_told(right):
    (found,) = told(changed(right, 0.05 * np.asarray(right.images) + 0.6 * right.mask[..., None]))
    assert found.kind == "ambient" and "the pictures hardly differ" in found.message


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


def test_near_lamps_are_told_of_what_shines():
    (found,) = told(near_lamps(3.0, sheen=0.25))
    assert found.kind == "near" and found.numbers["distance_widths"] == 3.0


@pytest.mark.parametrize("sheen", [0.0, 0.25])
def test_distant_lamps_are_not_near_ones(sheen):
    assert told(near_lamps(100.0, sheen)) == []


def shining(truth: Normals, strength: float, exponent: float, lights: np.ndarray = LIGHTS) -> Capture:
    """A right capture with highlights: `strength` of full brightness, (n.h)^exponent wide."""
    half = normalised(lights + np.array([0, 0, 1]))
    matt = (truth.map @ lights.T).clip(0)
    I = 0.3 * matt + strength * (matt > 0) * (truth.map @ half.T).clip(0) ** exponent
    images = I.transpose(2, 0, 1)[..., None].astype(np.float32)
    return noisy(Capture(images / images.max(), truth.mask, lights), 3)


@pytest.mark.parametrize(("strength", "exponent"), [(0.2, 60), (0.6, 25), (1.0, 8), (2.0, 30), (5.0, 15)])
def test_shine_is_neither_another_light_nor_an_encoding(strength, exponent):
    capture = shining(bumps(), strength, exponent)
    assert [f.kind for f in findings_of(capture) if f.kind != "saturation"] == []
    s = samples.read(capture)
    assert explanation(Distant(s.I, LIGHTS), s.mask, 16, linearised=False) == []


@pytest.mark.parametrize(("level", "of_silent_jpeg"), [(0.1, "encoding"), (0.2, "ambient")])
def test_what_lifts_the_dark_of_jpeg_files_that_say_nothing_is_their_encoding_but_where_light_explains_it_well(
    level, of_silent_jpeg
):
    s = samples.read(shining(bumps(), 0.3, 25))
    lifted = Distant((s.I / s.I.max() + level) / (1 + level), LIGHTS)
    said = [explanation(lifted, s.mask, 8, False, encoded)[0] for encoded in (False, True)]
    assert [f.kind for f in said] == ["ambient", of_silent_jpeg] and said[1].options.get("srgb", False) == (
        level == 0.1
    )


@pytest.mark.parametrize("exponent", [2, 5])
def test_sheen_of_a_ball_is_no_near_lamp(exponent):
    """What faces a lamp lies on its side of the ball, so that places explain sheen nearly as well as normals do."""
    assert told(shining(sphere(72), 0.2, exponent)) == []


@pytest.mark.parametrize("domed", [0.3, 0.5])
@pytest.mark.parametrize("exponent", [4, 8])
def test_sheen_of_a_domed_tablet_is_no_near_lamp(domed, exponent):
    y, x = np.mgrid[1:-1:72j, -1:1:72j]
    map = normalised(np.stack([domed * x, domed * y, np.ones_like(x)], axis=-1)).astype(np.float32)
    assert told(shining(Normals(map, np.ones(x.shape, bool)), 0.3, exponent)) == []


@pytest.mark.parametrize("exponent", [100, 300])
def test_shine_of_flat_ground_is_no_brighter_light(exponent):
    """Most of the object mirrors the same lamps; the balls that stand on it show how bright these are."""
    size, map = 72, np.zeros((72, 72, 3))
    y, x = np.mgrid[:size, :size].astype(float)
    map[..., 2] = 1
    for column, row, r in ((18, 20, 11), (50, 24, 13), (30, 52, 12)):
        u, v = (x - column) / r, (row - y) / r
        ball = np.stack([u, v, np.sqrt(np.maximum(1 - u**2 - v**2, 0))], axis=-1)
        map = np.where((u**2 + v**2 < 0.9)[..., None], ball, map)
    capture = shining(Normals(map.astype(np.float32), np.ones((size, size), bool)), 0.3, exponent)
    assert "intensities" not in {f.kind for f in findings_of(capture)}
    images = np.array(capture.images)
    images[16] *= 0.6
    (found,) = [f for f in findings_of(replace(capture, images=images)) if f.kind == "intensities"]
    assert "image 17 x 0.6" in found.message


@pytest.mark.parametrize(("strength", "exponent"), [(1.0, 30), (2.0, 20)])
def test_shine_of_a_rough_plate_is_no_brightness_of_its_lights(strength, exponent):
    """It faces the camera: the nearer a light is to the view, the brighter the whole plate shines."""
    import cv2

    lights = np.concatenate([dome(14, 40.0), dome(4, 10.0)[:2]])
    g = np.random.default_rng(0)
    blobs, grain = (cv2.GaussianBlur(g.standard_normal((72, 72)), (0, 0), sigma) for sigma in (3.0, 1.0))
    z_y, z_x = np.gradient(np.where(4 * blobs > 1, 12 * blobs, 0) + 0.5 * grain)
    map = normalised(np.stack([-z_x, z_y, np.ones_like(z_x)], axis=-1)).astype(np.float32)
    plate = Normals(map, np.ones(z_x.shape, bool))
    assert "intensities" not in {f.kind for f in findings_of(shining(plate, strength, exponent, lights))}
    matter = shining(plate, 0.3, 30, lights)
    uneven = g.uniform(0.4, 1, len(lights))[:, None, None, None] * np.asarray(matter.images)
    (found,) = [f for f in findings_of(changed(matter, uneven)) if f.kind == "intensities"]
    assert found.grave and "differ from those given" in found.message


@pytest.mark.parametrize(
    ("strokes", "sheen", "exponent"), [(0.15, 0.6, 60), (0.4, 0.3, 60), (0.4, 0.6, 60), (0.15, 0.3, 60)]
)
def test_a_varnished_panel_is_left_alone(strokes, sheen, exponent):
    """It is flat: its shine follows where a light stands, as a factor for each light would, or other angles."""
    import cv2

    g = np.random.default_rng(3)
    lights = normalised(np.concatenate([g.uniform(-0.5, 0.5, (24, 2)), np.ones((24, 1))], axis=1))
    z_y, z_x = np.gradient(strokes * cv2.GaussianBlur(g.standard_normal((80, 80)), (0, 0), 1.5))
    N = normalised(np.stack([-z_x, z_y, np.ones_like(z_x)], axis=-1))
    paint = 0.2 + 0.5 * (cv2.GaussianBlur(g.random((80, 80)), (0, 0), 5) > 0.5)
    half = normalised(lights + np.array([0, 0, 1]))
    I = paint[..., None] * (N @ lights.T).clip(0) + sheen * (N @ half.T).clip(0) ** exponent
    images = (I.transpose(2, 0, 1) / I.max())[..., None].astype(np.float32)
    assert [
        f
        for f in findings_of(noisy(Capture(images, np.ones((80, 80), bool), lights)))
        if f.grave or f.lights is not None
    ] == []


def test_light_that_shadows_take_away_does_not_stay_on(right):
    """A surface that is brighter than a matt one wherever it is lit fits I = b.l + c, but its shadows are dark."""
    images = np.asarray(right.images)
    lifted = images + 0.15 * (images > 0.02)
    assert (images[:, right.mask].min(0) <= 0.02).mean() > 0.5
    assert "ambient" not in {f.kind for f in told(changed(right, lifted))}


@pytest.mark.parametrize("times", [1.5, 2.8])
def test_angles_off_by_another_factor_are_no_halfway_ones(right, times):
    assert "halfway" not in {f.kind for f in told(replace(right, lights=raised(LIGHTS, 1 / times)))}
