"""Facts about lamps near the object, which every classical method meets."""

from dataclasses import replace

import numpy as np
import pytest

from photonormal import Capture, InputError, solve
from photonormal.geometry import angle_deg
from photonormal.methods import METHODS
from photonormal.methods.albedo import lambertian_albedo
from photonormal.methods.engine import near
from photonormal.types import Lamps, Normals
from tests.near import ORTHOGRAPHIC, PERSPECTIVE, bump, dome, photographed

CLASSICAL = [name for name, place in METHODS.items() if ".classical." in place]
MEAN_DEG = {"rpca": 1, "monotonic": 1, "consensus": 5}  # others: 0.1
CAMERAS = {"orthographic": ORTHOGRAPHIC, "perspective": PERSPECTIVE}


def hill(camera=ORTHOGRAPHIC, size: int = 32, widths: float = 2.0) -> Capture:
    """A hill under 13 lamps as many of its widths away, which shine most towards its middle."""
    X, truth = bump(camera, size)
    middle = camera.flat_mm(truth.mask).mean(0)
    S = dome(13, widths * size, middle)
    albedo = 0.4 + 0.2 * np.sin(X[..., 0] / 3)
    return photographed(camera, Lamps(S, axes=middle - S, mu=np.full(13, 0.8)), X, truth, albedo)


def mean_deg(found: Normals, capture: Capture) -> float:
    assert capture.truth is not None
    assert found.mask.all()
    return float(angle_deg(found.map[found.mask], capture.truth.map[found.mask]).mean())


@pytest.mark.parametrize("method", [m for m in CLASSICAL if m not in ("consensus", "table", "ward")])
@pytest.mark.parametrize("view", CAMERAS)
def test_as_exact_as_under_distant_lights(method, view):
    capture = hill(CAMERAS[view])
    assert mean_deg(solve(capture, method, device="cpu"), capture) < MEAN_DEG.get(method, 0.1)
    assert mean_deg(solve(replace(capture, lamps=None), method, device="cpu"), capture) > 6


@pytest.mark.parametrize("method", ["consensus", "table", "ward"])
def test_slow_methods_too(method):
    capture = hill(size=12)
    assert mean_deg(solve(capture, method, device="cpu"), capture) < MEAN_DEG.get(method, 0.1)


@pytest.mark.parametrize("view", CAMERAS)
def test_networks_see_each_pixel_s_lights(view):
    capture = hill(CAMERAS[view], size=40)
    assert mean_deg(solve(capture, "normalnet", device="cpu"), capture) < 1.5
    assert mean_deg(solve(replace(capture, lamps=None), "normalnet", device="cpu"), capture) > 6


def test_lamps_very_far_away_are_distant_lights():
    capture = hill(widths=3e3)
    far = solve(replace(capture, lamps=None), "woodham", device="cpu")
    assert angle_deg(solve(capture, "woodham", device="cpu").map, far.map).max() < 0.05


@pytest.mark.parametrize("method", CLASSICAL)
def test_pixels_that_see_the_lights_where_all_do_get_the_same_normals(method):
    capture = replace(hill(size=8, widths=1e4), lamps=None)
    each = np.tile(capture.known_lights().astype(np.float32), (8 * 8, 1, 1))
    a, b = solve(capture, method, device="cpu"), solve(replace(capture, lights_at=each), method, device="cpu")
    assert angle_deg(a.map, b.map).mean() < 0.02


def test_the_albedo_is_that_of_the_surface():
    capture = hill()
    assert capture.truth is not None
    rho = lambertian_albedo(capture, capture.truth)[..., 0]
    X, _ = bump(ORTHOGRAPHIC, 32)
    np.testing.assert_allclose(rho, 0.4 + 0.2 * np.sin(X[..., 0] / 3), rtol=2e-3)


def test_evened_pictures_hold_no_fall_off():
    capture = hill()
    assert capture.truth is not None
    X, _ = bump(ORTHOGRAPHIC, 32)
    seen = near.without_fall_off(capture, X.reshape(-1, 3))
    assert seen.lights_at is not None
    cos = np.einsum("pi,pni->np", capture.truth.map.reshape(-1, 3), seen.lights_at[:])
    rho = 0.4 + 0.2 * np.sin(X[..., 0] / 3)
    for j in range(13):
        np.testing.assert_allclose(seen.images[j][..., 0].ravel(), rho.ravel() * cos[j].clip(0), atol=1e-5)


def test_rotations_take_views_to_z():
    v = np.random.default_rng(0).normal(size=(50, 3)) * [0.3, 0.3, 0] + [0, 0, 1]
    R = near.turns(v)
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)
    np.testing.assert_allclose((R @ v[..., None])[..., 0], np.linalg.norm(v, axis=1)[:, None] * [0, 0, 1], atol=1e-12)


def test_near_lights_without_positions_are_refused():
    with pytest.raises(InputError, match="no positions of its lights"):
        near.near(replace(hill(), lamps=None))


def test_black_pictures_are_called_dark():
    capture = hill(size=16)
    with pytest.raises(InputError, match="inside the mask are dark"):
        solve(replace(capture, images=np.zeros(capture.images.shape, np.float32)), "woodham", device="cpu")
