"""Cast shadows of solids of which each pixel's ray shows three heights.

They are those of the visible surface, of where the ray leaves the solid behind it, and of where it enters it again;
below that all is taken as solid.

Distant lights first take all below the visible surface as solid (`horizon`). All points are answered at once, at the
same cost for any distance of the occluder: the heights are cut into lines along each light's azimuth (a shear by linear
interpolation). Along a line a point at distance u towards the light is in shadow when some h(u') - u' tan(elevation)
farther on exceeds its own: one running maximum answers for all points of the line. The rays that it stops, about a
tenth, are marched pixel by pixel, since they may pass below (`march`). So are all rays to lamps nearby.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from photonormal.shading import cosines

STEEPEST = 24.0  # pixels that a ray rises per pixel at most: a light overhead casts no shadow worth having
WRAP = 16384.0  # keeps the part of a line that re-enters on the other side apart from the first part
STEEP = 6.0  # slope up to which a pixel's height is carried over to the lines beside it
STEPS = 2**16  # of all marched rays together that are taken at once
BIAS, SOFT = 0.05, 0.5  # pixels of depth below the ray at which a shadow begins, and over which it becomes full


@dataclass(frozen=True)
class Horizon:
    """For each light and line the running maximum, ready to be asked at any pixel."""

    running: Float[Tensor, "j bn t"]  # over the samples nearer to the light than j
    slope: Float[Tensor, "b n"]
    rise: Float[Tensor, "b n"]
    along_rows: Float[Tensor, "b n"]  # 1 where lines run along columns' index, 0 along rows'
    forward: Float[Tensor, "b n"]  # 1 where the light is towards growing indices
    size: int

    def visibility(
        self, pixel: Int[Tensor, "b p"], height: Float[Tensor, "b p"], normals: Float[Tensor, "b 3 p"] | None = None
    ) -> Float[Tensor, "b n p"]:
        """1 where a light reaches a pixel (row * size + column) at a height, 0 where it doesn't, between at edges.

        A pixel lies between two lines. With its normal its height is carried over to each of them, without which steep
        slopes along a light's azimuth shadow themselves.
        """
        s, (b, n) = self.size, self.slope.shape
        row, col = (pixel // s).to(torch.float32)[:, None], (pixel % s).to(torch.float32)[:, None]  # (b, 1, p)
        along = self.along_rows[..., None] > 0
        major = torch.where(along, col, row)  # (b, n, p)
        minor = row + col - major
        j = torch.where(self.forward[..., None] > 0, s - 1 - major, major)  # 0 is nearest to the light
        start = minor - self.slope[..., None] * j  # where the line through the pixel begins
        turns = torch.floor(start / s)
        start = start - turns * s
        t = start.floor().clamp_(max=s - 1)
        f = start - t
        own = height[:, None] + self.rise[..., None] * j + WRAP * turns.abs()
        t, lines = t.to(torch.int32), torch.arange(b * n, device=t.device, dtype=torch.int32).view(b, n, 1)
        line = (j.to(torch.int32) * (b * n) + lines) * s
        index = (line + t).flatten()
        last = (line + (t + 1).clamp(max=s - 1)).flatten()
        values = self.running.flatten()
        first, second = (values.index_select(0, i).view_as(own) - own for i in (index, last))
        if normals is not None:
            x, y, z = normals[:, None].unbind(2)  # (b, 1, p)
            z = z.clamp(min=1e-3)
            across = torch.where(along, y / z, -x / z).clamp_(-STEEP, STEEP)  # height per pixel of the minor axis
            first += f * across
            second -= (1 - f) * across
        share = torch.where(minor < f, 1.0, f)  # the first line is still on the other side
        share = torch.where(minor + 1 - f > s - 1, 0.0, share)  # the second is there already
        return torch.lerp(_lit(first), _lit(second), share)


def _lit(depth: Tensor) -> Tensor:
    """Visibility of a point `depth` pixels below the highest ray past its occluders."""
    depth = torch.where(depth > WRAP / 2, -1.0, depth)  # a neighbouring line that wrapped around
    return ((BIAS + SOFT - depth) / SOFT).clamp_(0, 1)


def horizon(height: Float[Tensor, "b s s"], L: Float[Tensor, "b n 3"]) -> Horizon:
    """Running maxima of the height field (pixels; far below zero where there is nothing) towards each light."""
    (b, n, _), s = L.shape, height.shape[-1]
    dc, dr = L[..., 0], -L[..., 1]  # towards growing columns and growing rows
    along = dc.abs() >= dr.abs()
    major = torch.where(along, dc, dr)
    size = major.abs().clamp(min=1e-6)
    forward = major > 0
    slope = torch.where(along, dr, dc) / size  # minor pixels per major pixel towards the light
    slope = -slope  # per step of j, which leads away from the light
    rise = (L[..., 2].clamp(min=0) / size).clamp(max=STEEPEST)
    j = torch.arange(s, device=L.device, dtype=torch.float32)
    t = torch.arange(s, device=L.device, dtype=torch.float32)
    c = t + (slope.reshape(1, -1, 1) * j.view(s, 1, 1))  # (j, bn, t)
    turns = torch.floor(c / s)
    c = c - turns * s
    c0 = c.floor().clamp_(max=s - 1)
    f = c - c0
    m = torch.where(forward.reshape(1, -1, 1), s - 1 - j.view(s, 1, 1), j.view(s, 1, 1))  # (j, bn, 1)
    along_f = along.reshape(1, -1, 1).to(torch.float32)
    stride = s - (s - 1) * (1 - along_f)  # of the minor axis in memory
    scene = torch.arange(b, device=L.device, dtype=torch.int32).repeat_interleave(n).view(1, -1, 1) * (s * s)
    start = m * (s + 1 - stride)
    flat = height.flatten()
    near = flat.index_select(0, ((start + c0 * stride).to(torch.int32) + scene).flatten())
    far = flat.index_select(0, ((start + (c0 + 1).clamp_(max=s - 1) * stride).to(torch.int32) + scene).flatten())
    G = torch.lerp(near.view_as(c), far.view_as(c), f)
    G += rise.reshape(1, -1, 1) * j.view(s, 1, 1)
    G += turns.abs_().mul_(WRAP)
    running = torch.empty_like(G)
    running[0] = -4 * WRAP
    for k in range(1, s):
        torch.maximum(running[k - 1], G[k - 1], out=running[k])
    return Horizon(running, slope, rise, along.float(), forward.float(), s)


def distant(
    solid: Float[Tensor, "b 3 s s"],
    L: Float[Tensor, "b n 3"],
    pixel: Int[Tensor, "b p"],
    normals: Float[Tensor, "b 3 p"],
    few: int = 8,
) -> Float[Tensor, "b n p"]:
    """1 where a light reaches a pixel that faces it, 0 where it doesn't, between at edges; `few` lights at a time.

    `solid` are the heights (pixels) of the visible surface, of where rays leave the solid, and of where they enter it
    again, far below zero where there is nothing.
    """
    s = solid.shape[-1]
    height = solid[:, 0].contiguous()
    own = height.flatten(1).gather(1, pixel.long())
    visible = torch.cat([horizon(height, part).visibility(pixel, own, normals) for part in L.split(few, 1)], 1)
    facing = cosines(normals.transpose(1, 2), L).transpose(1, 2) > 0
    scene, light, at = stopped = (facing & (visible < 1)).nonzero().unbind(1)
    step = L * L.new_tensor([1, -1, 1])
    step = (step / step[..., :2].abs().amax(-1, keepdim=True).clamp(min=1e-6))[scene, light]
    depth = march(solid, scene * (s * s) + pixel[scene, at], step, torch.full_like(step[:, 0], s))
    free = _lit(depth + BIAS + SOFT / 2)  # no surface shadows itself here, so that edges lie in the middle
    return visible.index_put_(stopped, torch.maximum(visible[stopped], free))


def nearby(
    solid: Float[Tensor, "b 3 s s"], lamps: Float[Tensor, "b n 3"], pixel: Int[Tensor, "b p"], few: int = 8
) -> Float[Tensor, "b n p"]:
    """As `distant`, of lamps at (column, row, height)."""
    s, own = solid.shape[-1], pixel.long()
    X = torch.stack([own % s, own // s, solid[:, 0].flatten(1).gather(1, own)], -1)
    scene = torch.arange(len(own), device=own.device)[:, None]
    parts = []
    for part in lamps.split(few, 1):
        d = part[:, :, None] - X[:, None]  # (b, m, p, 3)
        reach = d[..., :2].abs().amax(-1, keepdim=True).clamp(min=1e-3)
        start = (scene * (s * s) + own)[:, None].expand(d.shape[:3]).flatten()
        depth = march(solid, start, (d / reach).flatten(0, 2), reach.flatten())
        parts.append(_lit(depth).view(d.shape[:3]))
    return torch.cat(parts, 1)


def march(
    solid: Float[Tensor, "b 3 s s"], start: Int[Tensor, " k"], step: Float[Tensor, "k 3"], reach: Float[Tensor, " k"]
) -> Float[Tensor, " k"]:
    """How deep in the solid rays come that start on its surface, at pixels (scene * size^2 + row * size + column).

    A step (columns, rows, height) is one pixel along the longer of the first two, so that a ray is always between two
    pixels of a column or a row; the lamp is `reach` steps away. Depths are in pixels, -1 at least; a ray in full shadow
    isn't followed further.
    """
    s = solid.shape[-1]
    top, leaves, enters = (heights.flatten() for heights in solid.unbind(1))
    rays = grid_rays(start, top[start], step, s)
    highest = solid[:, 0].amax((1, 2))[start // (s * s)]
    last = rays.last.minimum(reach).minimum((highest - rays.z) / rays.rise.clamp(min=1e-3))
    rays = rays._replace(last=last)

    def depth(index: Int[Tensor, "2 m k"], ray: Float[Tensor, "m k"]) -> Float[Tensor, "2 m k"]:
        """Of rays in the solid, negative outside of it."""
        h, l, e = (x.index_select(0, index.flatten()).view_as(index) for x in (top, leaves, enters))
        return depth_in(h, l, e, ray)

    number, deepest = torch.arange(len(start), device=top.device), torch.full_like(rays.z, -1.0)
    begin = 1
    while len(number):
        count = max(4, min(32, STEPS // len(number)))  # steps at once; then rays that have arrived are dropped
        k = torch.arange(begin, begin + count, device=top.device, dtype=torch.int32)[:, None]  # (m, 1)
        t, ray = k * rays.slope, rays.z + k * rays.rise  # (m, k)
        i = t.floor()
        index = rays.at + k * rays.major + i.int() * rays.minor
        first, second = depth(torch.stack([index, index + rays.minor]).clamp_(0, len(top) - 1), ray)
        met = torch.lerp(first, second, t - i)
        met = torch.where(k <= rays.last, met, -1.0).amax(0)
        deepest[number] = torch.maximum(deepest[number], met)
        begin += count
        open = ((begin <= rays.last) & (met < BIAS + SOFT)).nonzero()[:, 0]
        number, rays = number[open], rays.some(open)
    return deepest


class Rays(NamedTuple):
    """Rays over the pixels of maps of side s, scene after scene, that go one pixel along at each step.

    Parameters
    ----------
    at, z : index of the pixel where each starts, and its height there
    slope, rise : pixels across and height at each step
    major, minor : what a pixel along and one across add to an index
    last : steps that it takes at most
    """

    at: Int[Tensor, " k"]
    z: Float[Tensor, " k"]
    slope: Float[Tensor, " k"]
    rise: Float[Tensor, " k"]
    major: Int[Tensor, " k"]
    minor: Int[Tensor, " k"]
    last: Float[Tensor, " k"]

    def some(self, index: Int[Tensor, " m"]) -> Rays:
        """Those with these numbers."""
        return Rays(*(x.index_select(0, index) for x in self))


def grid_rays(start: Int[Tensor, " k"], z: Float[Tensor, " k"], step: Float[Tensor, "k 3"], s: int) -> Rays:
    """Rays from heights `z` over pixels until they leave the picture of side `s`.

    A step (columns, rows, height) is one pixel along the longer of the first two.
    """
    dc, dr, rise = step.unbind(1)

    def inside(x: Tensor, d: Tensor) -> Tensor:
        return torch.where(d > 0, s - 1 - x, x) / d.abs().clamp(min=1e-6)

    along = dc.abs() >= dr.abs()
    major, minor = torch.where(along, dc.sign(), s * dr.sign()).int(), torch.where(along, s, 1).int()
    last = torch.minimum(inside(start % s, dc), inside(start // s % s, dr))
    return Rays(start.int(), z, torch.where(along, dr, dc), rise, major, minor, last)


def depth_in(top: Tensor, leaves: Tensor, enters: Tensor, level: Tensor) -> Tensor:
    """How deep in the solid a height is, negative outside of it."""
    return torch.maximum(torch.minimum(top - level, level - leaves), enters - level)
