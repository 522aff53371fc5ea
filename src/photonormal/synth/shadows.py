"""Cast shadows of a height field; what the camera can't see is taken as solid below the visible surface.

Distant lights (`horizon`), all at once, at the same cost for any distance of the occluder: the field is cut into lines
along each light's azimuth (a shear by linear interpolation). Along a line a point at distance u towards the light is in
shadow when some h(u') - u' tan(elevation) farther on exceeds its own: one running maximum answers for all points of the
line. Lamps nearby (`reached`), slower: every ray is marched pixel by pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

STEEPEST = 24.0  # pixels that a ray rises per pixel at most: a light overhead casts no shadow worth having
WRAP = 16384.0  # keeps the part of a line that re-enters on the other side apart from the first part
STEEP = 6.0  # slope up to which a pixel's height is carried over to the lines beside it
FLOOR = -1e4  # pixels: lower than any surface
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


def reached(
    height: Float[Tensor, "b s s"], X: Float[Tensor, "b p 3"], middle: Float[Tensor, "b 1"], S: Float[Tensor, "b n 3"]
) -> Float[Tensor, "b n p"]:
    """1 where a lamp at `S` reaches a point of the surface, 0 where it doesn't, between at edges.

    Points and lamps are in pixels, x right, y up, z over the height `middle`, from the middle of the height field.
    """
    s = height.shape[-1]
    d = S[:, :, None] - X[:, None]  # (b, n, p, 3)
    across = d[..., :2].norm(dim=-1).clamp(min=1e-3)
    step = d / across[..., None]  # moves by a pixel across the picture
    top = height.amax((1, 2)) - middle[:, 0]
    over = ((top[:, None, None] - X[:, None, :, 2]) / step[..., 2].clamp(min=1e-3)).clamp(max=1.5 * s)
    ground = (height - middle[..., None] - FLOOR)[:, None]  # so that what lies outside is low
    depth = torch.full_like(across, FLOOR)
    for k in range(1, int(torch.minimum(over, across).amax()) + 1):
        q = X[:, None] + k * step
        grid = q[..., :2] * (2 / s) * q.new_tensor([1, -1])
        h = F.grid_sample(ground, grid, mode="bilinear", padding_mode="zeros", align_corners=False)[:, 0] + FLOOR
        depth = torch.where(k < across, torch.maximum(depth, h - q[..., 2]), depth)
    return _lit(depth)
