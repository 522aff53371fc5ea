"""What pixels of one material tell together: sums over those near a pixel that look alike."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

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
