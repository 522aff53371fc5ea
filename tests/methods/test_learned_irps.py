"""Neural inverse rendering learns an object from nothing but its own photographs."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from photonormal.geometry import angle_deg, fibonacci_hemisphere
from photonormal.methods import solve
from photonormal.methods.learned.irps import Normed, fix, reduced, reduced_mask
from photonormal.shading import half_vectors
from photonormal.types import Capture
from tests.scenes import lambertian, sphere

SHORT = {"iterations": 150, "width": 32, "images": 8}


def glossy(size: int = 32) -> Capture:
    """A sphere with a highlight under lights that all reach its middle."""
    truth, L = sphere(size), fibonacci_hemisphere(24)[:12]
    H = half_vectors(torch.from_numpy(L)).numpy()
    capture = lambertian(truth, L, 0.4)
    glare = 0.5 * np.einsum("hwc,nc->nhw", truth.map, H).clip(0)[..., None] ** 20
    return replace(capture, images=(np.asarray(capture.images) + glare * truth.mask[..., None]).astype(np.float32))


def error_deg(capture: Capture, method: str, **options) -> float:
    found, truth = solve(capture, method, device="cpu", **options), capture.truth
    assert truth is not None
    return float(angle_deg(found.map[truth.mask], truth.map[truth.mask]).mean())


def test_it_betters_least_squares_where_the_surface_shines():
    assert error_deg(glossy(), "irps", **SHORT) < 0.8 * error_deg(glossy(), "woodham")


def test_what_reduced_images_taught_is_carried_over_to_all_pixels():
    assert error_deg(glossy(48), "irps", **SHORT, pixels=700) < 0.9 * error_deg(glossy(48), "woodham")


def test_one_seed_gives_one_result_and_leaves_the_users_random_numbers_alone():
    capture, short = glossy(16), SHORT | {"iterations": 5}
    torch.manual_seed(3)
    first = solve(capture, "irps", device="cpu", **short).map
    drawn = torch.rand(1)
    torch.manual_seed(3)
    assert torch.equal(torch.rand(1), drawn)
    assert np.array_equal(first, solve(capture, "irps", device="cpu", **short).map)
    assert not np.array_equal(first, solve(capture, "irps", device="cpu", **short, seed=1).map)


def test_statistics_are_those_of_the_mask_and_stay_once_they_are_fixed():
    torch.manual_seed(0)
    norm, mask = Normed(2), torch.zeros(1, 1, 4, 4)
    mask[..., :2] = 1
    x = torch.randn(3, 2, 4, 4) + 5 - 100 * (1 - mask)
    norm(x, mask)
    inside = x[..., :2]
    assert torch.allclose(norm.mean.flatten(), inside.mean((0, 2, 3)), atol=1e-4)
    assert norm.scale.flatten().tolist() == pytest.approx(
        inside.var((0, 2, 3), correction=0).rsqrt().tolist(), rel=1e-3
    )
    before = norm.mean.clone()
    norm.apply(fix)
    norm(2 * x, mask)
    assert torch.equal(norm.mean, before)


def test_a_reduced_image_is_the_mean_over_the_masks_pixels():
    mask = torch.tensor([[True, True, False], [True, False, False]])
    x = torch.tensor([[[[1.0, 2, 9], [6, 9, 9]]]])
    assert reduced(x, mask, 2).flatten().tolist() == [3, 0] and reduced_mask(mask, 2).tolist() == [[True, False]]
