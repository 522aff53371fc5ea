"""Observation maps: the samples of one pixel as a small picture, each where its light comes from.

S. Ikehata, "CNN-PS: CNN-based photometric stereo for general non-convex surfaces", ECCV 2018. A sample goes to the
nearest cell, whose place the paper rounds down. Of samples in one cell the brightest stays, of the paper's the last, so
that neither order nor portions of the images matter.
"""

from __future__ import annotations

from collections.abc import Callable
from math import radians

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional as F

Projection = Callable[[Tensor], Tensor]  # unit lights (*b, 3) -> where they are seen, (*b, 2) from -1 to 1


def seen_from_above(L: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 2"]:
    """The hemisphere as the camera would see it (Ikehata 2018)."""
    return L[..., :2]


def disc(side: int, device: torch.device | str = "cpu") -> Bool[Tensor, "s s"]:
    """The cells that a light can be in, `seen_from_above`."""
    nearest = (torch.linspace(-1, 1, side, device=device).abs() - 1 / (side - 1)).clamp(min=0)  # of a cell
    return nearest.square() + nearest.square()[:, None] <= 1


def by_angles(L: Float[Tensor, "*b 3"], reach_deg: float) -> Float[Tensor, "*b 2"]:
    """Angles against the view, across and up, over `reach_deg`; beyond that, the border (Li et al., CVPR 2019)."""
    angles = torch.atan2(L[..., :2], L[..., 2:].clamp(min=1e-6))
    return (angles / radians(reach_deg)).clamp(-1, 1)


def cells(L: Float[Tensor, "*b 3"], side: int, projection: Projection) -> Int[Tensor, "*b"]:
    """Numbers of the lights' cells in a map of `side` x `side`, counted row by row."""
    place = ((projection(L) + 1) / 2 * (side - 1)).round().long()  # (*b, 2)
    return place[..., 1] * side + place[..., 0]


def observation_maps(
    I: Float[Tensor, "p n"], L: Float[Tensor, "*l n 3"], side: int, projection: Projection
) -> Float[Tensor, "p s s"]:
    """The maps of `p` pixels under lights that all share, (n, 3), or their own, (p, n, 3); zero where no light is."""
    where = cells(L, side, projection).expand(I.shape)
    maps = I.new_zeros(len(I), side * side).scatter_reduce_(1, where, I, "amax")
    return maps.unflatten(1, (side, side))


def brightest_one(maps: Float[Tensor, "p s s"]) -> Float[Tensor, "p s s"]:
    """Maps over their brightest cell; black ones stay black."""
    return maps / maps.amax((1, 2), keepdim=True).clamp(min=1e-9)


def about_view(v: Float[Tensor, "*b 3"], angle: Tensor | float) -> Float[Tensor, "*b 3"]:
    """Vectors turned about the view axis, counter-clockwise, by an angle in radians (*b)."""
    angle = torch.as_tensor(angle, dtype=v.dtype, device=v.device)
    x, y, z = v.unbind(-1)
    c, s = angle.cos(), angle.sin()
    return torch.stack([c * x - s * y, s * x + c * y, z], dim=-1)


def mirrored(maps: Float[Tensor, "p s s"], N: Float[Tensor, "p 3"]) -> Float[Tensor, "p s s"]:
    """Maps as `seen_from_above`, mirrored about the plane of the view and each pixel's normal; zero from outside."""
    p, side = len(maps), maps.shape[-1]
    axis = F.normalize(N[:, :2], dim=1)  # (p, 2)
    at = torch.linspace(-1, 1, side, dtype=N.dtype, device=N.device)
    cell = torch.stack(torch.meshgrid(at, at, indexing="xy"), dim=-1).flatten(0, 1)  # (s s, 2): x, y
    other = 2 * (cell @ axis.T).T[..., None] * axis[:, None] - cell  # (p, s s, 2)
    grid = other.view(p, side, side, 2)
    return F.grid_sample(maps[:, None], grid.to(maps), mode="bilinear", align_corners=True)[:, 0]
