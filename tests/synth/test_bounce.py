"""Light between parts of the surface."""

import math

import torch

from photonormal.synth import bounce
from photonormal.synth.trace import NOWHERE

S = 64


def bowl():
    """A hemispherical bowl of radius 30 pixels in a plane: heights, mask and normals."""
    t = torch.arange(S) + 0.5 - S / 2
    x, y = t.expand(S, S), -t[:, None].expand(S, S)
    inside = x**2 + y**2 < 29.5**2
    z = -torch.where(inside, 900 - x**2 - y**2, 900 - 29.5**2).sqrt()
    n = torch.stack([-x, -y, -z]) / 30
    up = torch.tensor([0.0, 0, 1])[:, None, None]
    return z[None], inside[None], torch.where(inside, n, up)[None]


def met(height, mask, normals, behind=None, again=None):
    """Where rays arrive from the pixels of `mask`; below it all is solid, or down to `behind`, then `again`."""
    directions, _ = bounce.rays(normals.flatten(2).transpose(1, 2), 0)
    deep = torch.full_like(height, NOWHERE)
    solid = torch.stack([height, deep if behind is None else behind, deep if again is None else again], 1)
    found = bounce.hits(solid, normals, torch.arange(S * S)[None], directions)
    return torch.where(mask.flatten(1)[..., None], found, -1)


def test_in_a_bowl_under_a_light_overhead_a_quarter_arrives_everywhere():
    """All points of a sphere see each other alike: E = (1 / 4 pi R^2) times the light through the rim, pi R^2."""
    height, inside, normals = bowl()
    N = normals.flatten(2).transpose(1, 2)
    directions, density = bounce.rays(N, 0)
    found = met(height, inside, normals)[0].long()  # (q, m)
    lit = (normals[:, 2] * inside).flatten()  # n.l of a light overhead, which all see
    share = ((directions[0] @ N[0, :, :, None])[..., 0] / density[0] / bounce.RAYS) * (found >= 0)
    own = (share * lit[found.clamp(min=0)]).sum(1)
    at = torch.arange(S * S)
    arriving = bounce.spread(own[None, :, None], *bounce.around(inside.flatten(1), N, at[None]))[0, :, 0]
    r = ((at % S + 0.5 - 32) ** 2 + (at // S + 0.5 - 32) ** 2).sqrt()
    assert math.isclose(arriving[r < 24].mean(), 0.25 * (29.5 / 30) ** 2, abs_tol=0.015)
    assert arriving[r < 24].std() < 0.03


def test_convex_and_flat_surfaces_get_nothing():
    flat = torch.zeros(1, S, S)
    up = torch.zeros(1, 3, S, S)
    up[:, 2] = 1
    assert (met(flat, flat == 0, up) < 0).all()
    height, inside, normals = bowl()
    outward = normals * torch.tensor([-1.0, -1, 1]).view(1, 3, 1, 1)
    found = met(torch.where(inside, -height, NOWHERE), inside, outward)
    assert (found >= 0).float().mean() < 0.01


def test_walls_of_a_groove_of_few_pixels_see_each_other():
    """Of what leaves a wall of a right-angled groove, 1 - sin 45 degrees arrives at the other one."""
    place = torch.arange(S).expand(S, S) % 16 + 0.5
    height = (place - 8).abs()[None]
    side = torch.where(place < 8, 1.0, -1.0)
    normals = torch.stack([side, torch.zeros(S, S), torch.ones(S, S)])[None] * 0.5**0.5
    found = met(height, height >= 0, normals)[0].long()  # (q, m)
    N = normals.flatten(2).transpose(1, 2)
    directions, density = bounce.rays(N, 0)
    share = (directions[0] @ N[0, :, :, None])[..., 0].clamp(min=0) / density[0] / bounce.RAYS
    at, wall = torch.arange(S * S), side.flatten() > 0
    middle = (at % S // 16 == 1) & (at // S > 23) & (at // S < 40)
    across = (found >= 0) & (wall[found.clamp(min=0)] != wall[:, None])
    assert math.isclose((share * across).sum(1)[middle].mean(), 1 - 0.5**0.5, abs_tol=0.03)
    groove = (found % S // 16 == at[:, None] % S // 16)[middle]
    assert groove[(found >= 0)[middle]].float().mean() > 0.98


def test_the_top_of_a_step_sends_nothing_to_its_foot():
    """Both look up, so that neither sees the other; rays from below arrive at the top from behind."""
    height = torch.zeros(1, S, S)
    height[:, :, 32:] = 20
    up = torch.zeros(1, 3, S, S)
    up[:, 2] = 1
    assert (met(height, height >= 0, up) < 0).all()


def test_light_passes_behind_what_is_thin_and_not_through_what_is_solid():
    """A wall looks at a facing roof, over which a plate hangs that hides the middle of the roof from the camera."""
    column = torch.arange(S).expand(S, S)
    slope = torch.where(column < 32, 31.0 - column, column - 32.0)[None]
    n = torch.stack([torch.where(column < 32, 1.0, -1.0), torch.zeros(S, S), torch.ones(S, S)])[None] * 0.5**0.5
    plate = ((column > 36) & (column < 44))[None]
    up = torch.tensor([0.0, 0, 1]).view(1, 3, 1, 1)
    height, normals = torch.where(plate, 60.0, slope), torch.where(plate[:, None], up, n)
    left = (column < 24)[None]
    plate_alone = met(height, left, normals, *(torch.where(plate, h, NOWHERE) for h in (torch.tensor(58.0), slope)))
    nothing, block = met(slope, left, n), met(height, left, normals)
    beyond = [int(((found >= 0) & (found % S >= 44)).sum()) for found in (nothing, plate_alone, block)]
    assert 0.98 * beyond[0] < beyond[1] <= beyond[0]  # it hangs above all rays that arrive there
    assert beyond[2] == 0
    assert not plate.flatten()[plate_alone[plate_alone >= 0].long()].any()  # it looks away


def test_rays_leave_with_the_density_that_they_say():
    """Over it, the mean of the cosine is its integral over the hemisphere, pi, and that of its square is 2 pi / 3."""
    N = torch.randn(1, 400, 3, generator=torch.Generator().manual_seed(0))
    N = torch.nn.functional.normalize(N * torch.tensor([1, 1, 0.5]) + torch.tensor([0, 0, 1.5]), dim=-1)
    N = N[:, N[0, :, 2] > 0.1]
    d, density = bounce.rays(N, 1)
    assert torch.allclose(d.norm(dim=-1), torch.ones_like(density), atol=1e-5)
    cos = (d * N[:, :, None]).sum(-1)
    assert math.isclose((cos.clamp(min=0) / density).mean(), 1, abs_tol=0.01)  # densities are times pi
    assert math.isclose((cos.clamp(min=0) ** 2 / density).mean(), 2 / 3, abs_tol=0.01)


def test_what_arrives_along_a_ray_is_summed():
    rows = torch.tensor([[[1.0], [10.0], [100.0]], [[2.0], [20.0], [200.0]]])  # (2, 3, 1)
    row = torch.tensor([[[0, -1, 2], [1, -1, -1]], [[-1, -1, -1], [2, 1, 0]]])
    assert bounce.gather(rows, row)[..., 0].tolist() == [[101, 10], [0, 222]]


def test_neighbours_that_face_the_same_way_share_what_they_gather():
    on = torch.ones(1, S * S, dtype=torch.bool)
    up = torch.tensor([0.0, 0, 1]).expand(1, S * S, 3)
    pixel = torch.arange(0, S * S, 7)[None]
    out = bounce.spread(torch.full((1, S * S, 5), 2.5), *bounce.around(on, up, pixel))
    assert torch.allclose(out, torch.full_like(out, 2.5), atol=1e-4)
    column = (torch.arange(S * S) % S).float()[None, :, None]
    middle = torch.arange(S + 1, 2 * S - 1)[None]  # neighbours on both sides
    assert torch.allclose(bounce.spread(column, *bounce.around(on, up, middle))[0, :, 0], middle[0] % S * 1.0)


def test_across_a_fold_nothing_is_shared():
    on = torch.ones(1, S * S, dtype=torch.bool)
    left = (torch.arange(S * S) % S < S // 2)[None, :, None]
    fold = torch.where(left, torch.tensor([0.6, 0, 0.8]), torch.tensor([-0.6, 0, 0.8]))
    out = bounce.spread(left.float(), *bounce.around(on, fold, torch.arange(S * S)[None]))
    assert torch.allclose(out, left.float(), atol=1e-3)
