"""The visible surface of an implicit solid is where it is zero, and its normal is the gradient."""

import numpy as np
import torch

from photonormal.synth.params import rng, take
from photonormal.synth.sculptor import KINDS, draw_solids
from photonormal.synth.trace import NOWHERE, WindowView, approach, surface_gradient, survey, visible_surface


def seen(solids, b, size=64, half=1.1):
    device = torch.device("cpu")
    view = WindowView(torch.zeros(b, 2), torch.full((b,), half), size)
    return view, visible_surface(solids, view, approach(solids, view, survey(solids, b, device)[1]))


def each_seen(solids, b):
    """Each of `b` solids alone, its view, what is seen of it, and the points (1, 3, m) that are."""
    for i in range(b):
        solid = take(solids, slice(i, i + 1))
        view, g = seen(solid, 1)
        yield solid, view, g, g.points.flatten(2)[:, :, g.mask.flatten()]


def ball(radius=0.8):
    """The first plain solid, made a ball."""
    solids = draw_solids(rng(0), 1, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0)
    solids.parts.on[:] = torch.arange(solids.parts.on.shape[1]) == 0
    solids.parts.M[:] = torch.eye(3) / radius
    solids.parts.e[:] = 2
    solids.parts.c[:] = 0
    solids.lathe.on[:] = False
    return solids


def test_a_balls_depth_and_normals_are_exact():
    view, g = seen(ball(0.8), 1)
    x, y = (v.view(64, 64) for v in view.rays(64))
    inside = x**2 + y**2 < 0.79**2
    z = (0.64 - x**2 - y**2).clamp(min=0).sqrt()
    n = torch.stack([x, y, z]) / 0.8
    assert (g.mask[0] | ~inside).all() and not (g.mask[0] & (x**2 + y**2 > 0.8**2)).any()
    error = torch.rad2deg(torch.linalg.cross(g.normals[0], n, dim=0).norm(dim=0))[inside & (z > 0.1)]
    assert error.max() < 0.05
    assert (g.height[0] * view.pixel - z)[inside & (z > 0.1)].abs().max() < 1e-3


def test_rays_leave_a_ball_where_it_ends_and_enter_the_next():
    solids = ball(0.3)
    solids.parts.on[:, 1] = True
    solids.parts.c[:, :2] = torch.tensor([[0.0, 0, 0.5], [0.1, 0, -0.4]])
    solids.parts.c[:, 2:] = 0
    solids.wall_n[:], solids.wall_o[:] = torch.tensor([0.0, 0, 1]), -1.0  # what is seen deepest
    view, g = seen(solids, 1)
    x, y = (v.view(64, 64) for v in view.rays(64))
    leaves, enters = g.behind[0] * view.pixel
    first, second = x**2 + y**2 < 0.27**2, (x - 0.1) ** 2 + y**2 < 0.27**2
    for z, on, true in (
        (leaves, first, 0.5 - (0.09 - x**2 - y**2).clamp(min=0).sqrt()),
        (enters, first & second, -0.4 + (0.09 - (x - 0.1) ** 2 - y**2).clamp(min=0).sqrt()),
        (enters, first & ((x - 0.1) ** 2 + y**2 > 0.32**2), torch.full_like(x, -1.0)),
    ):
        assert (z - true)[on].abs().max() < 1.5 * view.pixel
        assert (z - true)[on].abs().mean() < 0.3 * view.pixel
    wall = (x**2 + y**2).sqrt() > 0.8
    assert (g.behind[0][:, wall] == NOWHERE).all()  # no light comes from below it


def test_what_is_behind_is_found_in_drawn_solids():
    """By steps of half a pixel, which miss nothing that is wider."""
    solids = draw_solids(rng(3), 6, (0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0), 0.5)
    for solid, view, g, p in each_seen(solids, 6):
        z, floor = p[0, 2] / view.pixel, (p[0, 2] / view.pixel).amin()
        field, down = solid.field(), torch.arange(2, 400)[:, None] / 2
        d = torch.stack([field(p - torch.tensor([0, 0, 1.0])[:, None] * k * view.pixel)[0] for k in down])
        deep = z - down < floor + 1
        out = (d > 0) & ~deep
        leaves = torch.where(out.any(0), z - 0.5 * out.int().argmax(0) - 1, NOWHERE)
        found = g.behind[0, 0].flatten()[g.mask.flatten()]
        found = torch.where(found < floor + 1, NOWHERE, found)
        assert ((found - leaves).abs() < 2).float().mean() > 0.96


def test_every_kind_is_seen_with_unit_normals_that_face_the_camera():
    for kind in range(len(KINDS)):
        solids = draw_solids(rng(kind), 2, tuple(float(kind == k) for k in range(len(KINDS))), 1.0)
        for _, _, g, _ in each_seen(solids, 2):
            assert g.mask.float().mean() > 0.05, KINDS[kind]
            n = g.normals.movedim(1, -1)[g.mask]
            assert torch.allclose(n.norm(dim=-1), torch.ones(len(n)), atol=1e-4)
            assert (n[:, 2] > 0).all()
            assert not g.normals.movedim(1, -1)[~g.mask].any()


def test_points_seen_lie_on_the_surface_and_nothing_lies_before_them():
    solids = draw_solids(rng(5), 4, (0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.3)
    for solid, view, _, p in each_seen(solids, 4):
        assert solid(p).abs().quantile(0.99) < 0.1 * view.pixel
        for step in (2, 6, 20):  # pixels in front
            ahead = p + torch.tensor([0.0, 0.0, 1.0])[:, None] * step * view.pixel
            assert (solid(ahead) > -0.5 * view.pixel).float().mean() > 0.97


def test_gradient_is_the_slope_of_the_function():
    solids = draw_solids(rng(2), 3, (0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0), 1.0)
    p = torch.from_numpy(np.random.default_rng(0).uniform(-1, 1, (3, 3, 50)).astype(np.float32))
    g = surface_gradient(solids, p)
    for axis in range(3):
        step = torch.zeros(3, 1)
        step[axis] = 2e-3
        slope = (solids(p + step) - solids(p - step)) / 4e-3
        assert (slope - g[:, axis]).abs().quantile(0.9) < 0.05


def test_scenes_together_are_the_scenes_one_by_one():
    solids = draw_solids(rng(3), 3, (1.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0), 0.7)
    _, together = seen(solids, 3)
    for i in range(3):
        _, alone = seen(take(solids, slice(i, i + 1)), 1)
        assert (alone.mask[0] == together.mask[i]).float().mean() > 0.995
        both = alone.mask[0] & together.mask[i]
        assert ((alone.height[0] - together.height[i]).abs()[both] < 0.05).float().mean() > 0.99


def test_thin_walls_are_not_stepped_over():
    """Walls of hollow turned solids, at least a pixel thick along the ray, against marching by half a pixel."""
    solids = draw_solids(rng(11), 8, (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    view, g = seen(solids, 8)
    step = view.pixel[0] / 2
    x, y = view.rays(64)
    field, inside = solids.field(), torch.zeros(3, 8, 64**2, dtype=torch.bool)  # at the last three steps
    first = torch.full((8, 64**2), -torch.inf)
    for z in torch.arange(1.7, -1.7, -step.item()):
        inside = torch.stack([*inside[1:], field(torch.stack([x, y, z.expand_as(x)], 1)) < 0])
        first = torch.where(inside.all(0) & (first == -torch.inf), z, first)
    there = first > -torch.inf
    below = ~g.mask.flatten(1) | (g.height.flatten(1) * view.pixel[:, None] < first - 4 * step)
    assert (there & below).sum() < 0.0015 * there.sum()


def test_pleats_are_steep_and_leave_other_solids_alone():
    """Normals of pleated solids turn more from pixel to pixel than those of the turned ones that they are made from."""

    def turning(kind: str) -> float:
        solids = draw_solids(rng(4), 6, tuple(float(kind == k) for k in KINDS), 0.0)
        _, g = seen(solids, 6)
        both = g.mask[..., 1:] & g.mask[..., :-1]
        return float((g.normals[..., 1:] - g.normals[..., :-1]).norm(dim=1)[both].mean())

    assert turning("pleated") > 1.5 * turning("turned")
