"""Observation maps: each light has its place, whatever the order and the portions of the images."""

from math import pi

import pytest
import torch

from photonormal.methods.inputs.maps import (
    about_view,
    brightest_one,
    by_angles,
    cells,
    disc,
    mirrored,
    observation_maps,
    seen_from_above,
)
from photonormal.shading import normalised

PROJECTIONS = [seen_from_above, lambda L: by_angles(L, 70.0)]


def samples(p=6, n=9, seed=0):
    g = torch.Generator().manual_seed(seed)
    L = normalised(torch.randn(n, 3, generator=g) + torch.tensor([0, 0, 1.5]))
    return torch.rand(p, n, generator=g), L * torch.tensor([1, 1, 1.0])


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_neither_order_nor_portions_change_a_map(projection):
    I, L = samples(n=30)
    maps = observation_maps(I, L, 8, projection)  # lights share cells
    order = torch.randperm(30, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(observation_maps(I[:, order], L[order], 8, projection), maps, atol=0, rtol=0)
    parts = [observation_maps(I[:, s], L[s], 8, projection) for s in (slice(0, 13), slice(13, 30))]
    torch.testing.assert_close(torch.maximum(*parts), maps, atol=0, rtol=0)
    each = observation_maps(I, L.expand(len(I), -1, -1), 8, projection)
    torch.testing.assert_close(each, maps, atol=0, rtol=0)


def test_a_light_is_where_it_is_seen():
    axes = torch.tensor([[0, 0, 1.0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    assert cells(axes, 5, seen_from_above).tolist() == [12, 14, 10, 22, 2]
    slanted = normalised(torch.tensor([[1.0, 0, 1], [0, 1.0, 1], [3.0, 0, 1]]))  # 45, 45 and 72 degrees
    assert cells(slanted, 5, lambda L: by_angles(L, 45.0)).tolist() == [14, 22, 14]
    assert cells(slanted, 5, lambda L: by_angles(L, 90.0)).tolist() == [13, 17, 14]
    I = torch.tensor([[0.5, 0.25, 0, 0, 1.0]])
    found = observation_maps(I, axes, 5, seen_from_above)[0]
    assert found[2, 2] == 0.5 and found[2, 4] == 0.25 and found[0, 2] == 1 and found.sum() == 1.75


def test_lights_fill_the_disc_and_nothing_else():
    around = torch.linspace(0, 2 * pi, 400)
    edge = torch.stack([around.cos(), around.sin(), 0 * around], dim=1)
    taken = torch.zeros(64, dtype=torch.bool)
    taken[cells(torch.cat([r * edge for r in (0.1, 0.3, 0.5, 0.7, 0.9, 1)]), 8, seen_from_above)] = True
    assert torch.equal(taken.view(8, 8), disc(8))


def test_maps_are_mirrored_about_the_normals_own_direction():
    maps = torch.rand(4, 9, 9)
    N = torch.tensor(
        [[0.6, 0, 0.8], [0, -0.6, 0.8], [0.5, 0.5, 0.7], [0, 0, 1.0]]
    )  # right, down, across, to the camera
    a, b, c, d = mirrored(maps, N)
    torch.testing.assert_close(a, maps[0].flip(0))
    torch.testing.assert_close(b, maps[1].flip(1))
    torch.testing.assert_close(c, maps[2].T)
    torch.testing.assert_close(d, maps[3].flip(0, 1))  # any plane through the view: half a turn


def test_exposure_leaves_a_map_and_black_stays_black():
    I, L = samples()
    I[2] = 0
    maps = brightest_one(observation_maps(I, L, 8, seen_from_above))
    torch.testing.assert_close(brightest_one(observation_maps(7 * I, L, 8, seen_from_above)), maps)
    assert not maps[2].any() and (maps.amax((1, 2))[[0, 1, 3, 4, 5]] == 1).all()


def test_a_turn_about_the_view():
    _, L = samples()
    turned = about_view(L, pi / 2)
    torch.testing.assert_close(turned, torch.stack([-L[:, 1], L[:, 0], L[:, 2]], dim=1))
    torch.testing.assert_close(about_view(turned, torch.full((9,), -pi / 2)), L)
