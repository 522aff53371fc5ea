"""How much of the sky a relief sees."""

import numpy as np
import pytest

from photonormal.handover.occlusion import SIDE, openness


@pytest.mark.parametrize("depth", [1.0, 0.5])
def test_everywhere_in_a_bowl_the_sky_is_one_minus_half_its_depth_over_its_radius(depth):
    """The form factor from any point of a sphere to a cap of it is the cap's share of the sphere."""
    size, radius = 201, 90.0
    y, x = np.mgrid[100:-101:-1, -100:101] / radius
    inside = x**2 + y**2 < 1 - (1 - depth) ** 2
    lower = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    height = np.where(inside, (1 - depth - lower) * radius, 0.0)
    N = np.where(inside[..., None], np.stack([-x, -y, lower], -1), [0.0, 0.0, 1.0])
    found = openness(height, N)
    well = x**2 + y**2 < 0.6 * (1 - (1 - depth) ** 2)
    assert found.shape == (size, size)
    assert np.abs(found[well] - (1 - depth / 2)).max() < 0.06
    assert np.abs(found[5, 5:-5] - 1).max() < 0.02


def test_a_plane_is_open_however_it_is_tilted_or_large():
    x = np.mgrid[:SIDE, : 2 * SIDE][1]
    for slope in (0.0, 0.7):
        N = np.broadcast_to(np.array([-slope, 0, 1]) / np.hypot(slope, 1), (*x.shape, 3))
        found = openness(slope * x.astype(float), N)
        assert found.shape == x.shape
        found = found[SIDE // 3 : -SIDE // 3, SIDE // 2 : -SIDE // 2]
        assert found.min() > 0.97 and found.max() <= 1
