"""Frames of the lights, on flat reliefs: what shading tells of them is found, what it doesn't tell is not claimed."""

import numpy as np
import pytest

from photonormal.calibration.intensities import robust_normals
from photonormal.doctor.frame import GIVEN, QUARTERS, LambertianFit, NormalsFrame, judged
from photonormal.geometry import fibonacci_hemisphere, normalised

LIGHTS = fibonacci_hemisphere(24)[:16]
SIZE = 72
RECTANGLE = np.pad(np.ones((SIZE - 16, SIZE - 8), bool), ((8, 8), (4, 4)))
WRONG = [frame for frame in QUARTERS if frame != GIVEN]


def engraved(seed: int) -> np.ndarray:
    """Heights (h, w) in pixels of a flat plate with shallow grooves."""
    rng, (y, x) = np.random.default_rng(seed), np.mgrid[:SIZE, :SIZE]
    z = np.zeros((SIZE, SIZE))
    for _ in range(14):
        (cx, cy), a = rng.uniform(8, SIZE - 8, 2), rng.uniform(0, np.pi)
        along, across = (x - cx) * np.cos(a) + (y - cy) * np.sin(a), (y - cy) * np.cos(a) - (x - cx) * np.sin(a)
        z -= 1.2 * np.exp(-((along / 9) ** 2) - (across / 2.5) ** 2)
    return z


def towers(seed: int, count: int = 14) -> np.ndarray:
    """Heights of a plate with tall pillars, which cast shadows."""
    rng, (y, x) = np.random.default_rng(seed), np.mgrid[:SIZE, :SIZE]
    z = 0.5 * np.sin(x / 7) * np.cos(y / 9)
    for cx, cy in rng.permutation([(i, j) for i in range(10, 70, 13) for j in range(10, 70, 13)])[:count]:
        z += 8 / (1 + np.exp((np.hypot(x - cx, (y - cy) * 1.3) - 3.5) / 0.6))
    return z


def seen(z: np.ndarray, frame: NormalsFrame, cast: bool = False, mask: np.ndarray = RECTANGLE) -> LambertianFit:
    """The plate, matt, photographed under LIGHTS that are given in another frame, cut by a mask."""
    z_y, z_x = np.gradient(z)
    N = normalised(np.stack([-z_x, z_y, np.ones_like(z)], axis=-1))
    I = 0.7 * np.maximum(N @ LIGHTS.T, 0)
    if cast:
        I = I * np.stack([~shadowed(z, l) for l in LIGHTS], axis=-1)
    I = (I + 0.002 * np.random.default_rng(1).standard_normal(I.shape)).clip(0)[mask]
    L = LIGHTS @ frame.matrix().T
    return LambertianFit(I, robust_normals(I, L, I > 0.014), mask, L)


def shadowed(z: np.ndarray, l: np.ndarray) -> np.ndarray:
    """Where something between a pixel and its light is higher than the ray."""
    y, x = np.mgrid[:SIZE, :SIZE]
    found = np.zeros(z.shape, bool)
    for t in np.arange(1, 30, 0.5):
        row, column = np.rint(y - t * l[1]).astype(int), np.rint(x + t * l[0]).astype(int)
        inside = (row >= 0) & (row < SIZE) & (column >= 0) & (column < SIZE)
        found[inside] |= z[row[inside], column[inside]] > z[inside] + t * l[2] + 0.3
    return found


@pytest.mark.parametrize("seed", range(4))
def test_right_lights_of_a_flat_relief_are_left_alone(seed):
    assert judged(seen(engraved(seed), GIVEN)).frame == GIVEN


@pytest.mark.parametrize("frame", WRONG)
def test_without_shadows_a_frame_is_told_up_to_half_a_turn(frame):
    """A relief turned inside out shows the same under lights half a turn on."""
    verdict = judged(seen(engraved(0), frame))
    assert not verdict.half
    undone = [f.matrix() @ frame.matrix() for f in (verdict.frame, verdict.frame.half_turned())]
    assert min(np.abs(M - np.eye(3)).max() for M in undone) < 1e-9


@pytest.mark.parametrize("frame", QUARTERS)
def test_shadows_tell_half_a_turn(frame):
    verdict = judged(seen(towers(0), frame, cast=True))
    assert verdict.half
    np.testing.assert_allclose(verdict.frame.matrix() @ frame.matrix(), np.eye(3), atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_shadows_of_mountains_that_fill_the_frame_tell_half_a_turn(seed):
    """Each pixel has slopes that turn their back to a light on both sides: only how high they rise tells."""
    f, rng = np.hypot(*np.meshgrid(*[np.fft.fftfreq(SIZE, 1 / SIZE)] * 2)), np.random.default_rng(seed)
    waves = (f > 1) * (f < 6) / np.maximum(f, 1) * np.exp(2j * np.pi * rng.random((SIZE, SIZE)))
    z = np.fft.ifft2(waves).real
    for frame in (GIVEN, GIVEN.half_turned()):
        verdict = judged(seen(20 * z / z.std(), frame, cast=True))
        assert verdict.half and verdict.frame == frame


@pytest.mark.parametrize("radius", [1.02, 1.2])
def test_what_a_material_darkens_on_a_dome_is_no_shadow_that_falls_the_wrong_way(radius):
    """Metal reflects little of light from aside; a dome casts no shadow, a bowl would."""
    y, x = np.mgrid[1 : -1 : 1j * SIZE, -1 : 1 : 1j * SIZE]
    N = normalised(np.stack([x, y, np.sqrt((radius**2 - x**2 - y**2).clip(0.01))], axis=-1))
    mask = x**2 + y**2 < 0.96
    I = (N @ LIGHTS.T).clip(0)[mask] ** 4
    fit = LambertianFit(I, robust_normals(I, LIGHTS, I > 0.014), mask, LIGHTS)
    assert fit.shadows.vote(np.eye(3)) >= 0


@pytest.mark.parametrize(("turn_deg", "along_deg"), [(5, 0), (-5, 0), (7, 175), (6, 60)])
def test_lights_a_little_off_are_no_mirrored_frame_of_parallel_folds(turn_deg, along_deg):
    """Folds mirrored about their own direction look as they did."""
    y, x = np.mgrid[: 2 * np.pi : 1j * SIZE, : 2 * np.pi : 1j * SIZE]
    a = np.radians(along_deg)
    across, along = x * np.cos(a) - y * np.sin(a), x * np.sin(a) + y * np.cos(a)
    folds = np.sin(4 * (across + 0.03 * np.sin(along + 1))) * (1 + 0.1 * np.sin(0.7 * along))
    assert judged(seen(folds, NormalsFrame(False, turn_deg))).frame == GIVEN
    assert judged(seen(folds, NormalsFrame(False, 90))).frame != GIVEN


@pytest.mark.parametrize("turned", [False, True])
def test_few_shadows_and_a_rim_that_is_no_outline_tell_half_a_turn_together(turned):
    """Two pillars on a coin whose rim falls off by 40 degrees, and the same without its rim."""
    y, x = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2
    r, frame = np.hypot(x, y), GIVEN.half_turned() if turned else GIVEN
    coin = towers(0, 2) - 0.84 * np.maximum(r - 28, 0)
    rim, inner = (judged(seen(coin, frame, True, mask=r < radius)) for radius in (33, 26))
    assert (rim.half, rim.frame) == (True, frame) and not inner.half


def test_a_hollow_plate_is_no_flipped_one():
    """A bowl's rim is no outline that turns away from the camera."""
    y, x = np.mgrid[-1 : 1 : 1j * SIZE, -1 : 1 : 1j * SIZE]
    assert judged(seen(12 * (x**2 + 1.3 * y**2) + 0.4 * np.sin(9 * x + 2 * y), GIVEN)).frame == GIVEN
