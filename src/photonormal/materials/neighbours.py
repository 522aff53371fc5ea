"""What pixels tell together: sums over those near a pixel that look alike, and how many of those near it are told."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

RADIUS = 2  # pixels, in rows and columns
ALIKE = 0.25  # standard deviation of a relative difference of colours


def pooled(values: Float[Tensor, "h w r"], colour: Float[Tensor, "h w c"]) -> Float[Tensor, "h w r"]:
    """Sum of the values of a pixel's neighbours, each times how much its colour is alike; colours 0 are nobody's."""
    h, w, _ = values.shape
    out = values.clone()
    for dy in range(-RADIUS, RADIUS + 1):
        for dx in range(-RADIUS, RADIUS + 1):
            if (dy, dx) == (0, 0) or abs(dy) >= h or abs(dx) >= w:
                continue
            here = slice(max(0, -dy), h - max(0, dy)), slice(max(0, -dx), w - max(0, dx))
            there = slice(max(0, dy), h + min(0, dy)), slice(max(0, dx), w + min(0, dx))
            a, b = colour[here], colour[there]
            size = (a.norm(dim=-1) + b.norm(dim=-1)).clamp(min=1e-12) / 2
            weight = torch.exp(-0.5 * ((a - b).norm(dim=-1) / size / ALIKE).square())
            out[here] += weight[..., None] * values[there]
    return out


def company(told: Bool[Tensor, "h w"], on: Bool[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """The share of told pixels among those near a pixel that are on the object, itself included."""
    counts = [avg_pool2d(which[None].float(), 2 * RADIUS + 1, 1, RADIUS)[0] for which in (told & on, on)]
    return counts[0] / counts[1].clamp(min=1e-6)
