"""What pixels show together: sums over like ones near a pixel, how many of those near it are known, means."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

RADIUS = 2  # pixels, in rows and columns
ALIKE = 0.25  # standard deviation of a relative difference of colours


def pooled(values: Float[Tensor, "h w r"], colour: Float[Tensor, "h w c"], rows: slice) -> Float[Tensor, "k w r"]:
    """In some rows, the sum of the values of a pixel's neighbours, each times how much its colour is alike.

    Colours 0 are nobody's.
    """
    h, w, _ = values.shape
    size = colour.norm(dim=-1)
    out = values[rows].clone()
    for dy in range(-RADIUS, RADIUS + 1):
        first, last = max(rows.start, -dy), min(rows.stop, h - max(0, dy))
        for dx in range(-RADIUS, RADIUS + 1):
            if (dy, dx) == (0, 0) or first >= last or abs(dx) >= w:
                continue
            here = slice(first, last), slice(max(0, -dx), w - max(0, dx))
            there = slice(first + dy, last + dy), slice(max(0, dx), w + min(0, dx))
            level = (size[here] + size[there]).clamp(min=1e-12) / 2
            apart = (colour[here] - colour[there]).norm(dim=-1) / level
            weight = torch.exp(-0.5 * (apart / ALIKE).square())
            out[first - rows.start : last - rows.start, here[1]].addcmul_(weight[..., None], values[there])
    return out


def company(told: Bool[Tensor, "h w"], on: Bool[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """The share of known pixels among those near a pixel that are on the object, itself included."""
    counts = [avg_pool2d(which[None].float(), 2 * RADIUS + 1, 1, RADIUS)[0] for which in (told & on, on)]
    return counts[0] / counts[1].clamp(min=1e-6)


def smooth(maps: Float[Tensor, "k h w"]) -> Float[Tensor, "k h w"]:
    """Means over a pixel's neighbours, near ones more: squares twice, zero beyond the edges."""
    return avg_pool2d(avg_pool2d(maps, 2 * RADIUS + 1, 1, RADIUS), 2 * RADIUS + 1, 1, RADIUS)
