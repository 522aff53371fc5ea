"""Layers that look around a pixel and add to what was known of it: at full, at a quarter, at an eighth of the size."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.methods.learned.layers import Block, conv
from photonormal.methods.learned.network import Step

FAR = 192  # channels at an eighth of the resolution
PIXELS = 2**13  # levelled at a time: their float32 features stay in a processor's cache

M = TypeVar("M", bound=nn.Module)


def starting_at(std: float, layer: M) -> M:
    """A layer whose weights start with that deviation: 0 where trained weights shall stay what they are."""
    layer.starts_at = std  # pyright: ignore[reportArgumentType]
    return layer


def begun(net: nn.Module) -> Iterator[tuple[nn.Parameter, float]]:
    """The weights that start in a way of their own, and their deviation there."""
    for module in net.modules():
        std = getattr(module, "starts_at", None)
        if std is not None:
            yield module.weight, std  # type: ignore[misc]


class Level(nn.Module):
    """Each pixel's features over their root mean square: layers learn at high rates whatever came before them."""

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        rows = x.permute(0, 2, 3, 1).split(max(1, PIXELS // x.shape[3]), dim=1)
        return torch.cat([F.rms_norm(some, (x.shape[1],)) for some in rows], dim=1).permute(0, 3, 1, 2)


class Refine(nn.Module):
    """Adds what two layers find."""

    reach = 2

    def __init__(self, width: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        self.first = conv(width, width)
        self.second = starting_at(0.0, nn.Conv2d(width, width, 3, padding=1))

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        return x + self.second(self.first(self.level(x)))


class Far(nn.Module):
    """Adds what is seen at half of the resolution of `x`."""

    def __init__(self, width: int, blocks: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        self.layers = nn.Sequential(Block(width, FAR, 2), *[Block(FAR, FAR) for _ in range(blocks)])
        self.last = starting_at(0.0, nn.Conv2d(FAR, width, 1, bias=False))
        self.reach = 5 + 4 * blocks  # pixels of `x`

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        y = self.level(self.layers(self.level(x)))
        return x + F.interpolate(self.last(y), scale_factor=2, mode="bilinear")


class QuarterView(nn.Module):
    """What is seen at a quarter of the resolution, and with `far` blocks at an eighth: see `steps`."""

    def __init__(self, width: int, layers: int, far: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        strides = [2, 2] + [1] * layers
        self.layers = nn.Sequential(*[conv(width, width, s) for s in strides])
        self.far = Far(width, far, level) if far else nn.Identity()
        self.join = Refine(width, level) if far else nn.Identity()
        self.last = starting_at(0.0, nn.Conv2d(width, width, 1, bias=False))
        self.stride = 8 if far else 4

    def steps(self, reads: str, gives: str) -> list[Step]:
        """To a quarter of the resolution, where a pixel sees less than four around; and what is seen around there."""
        further = len(self.layers) - 2
        far, join = (getattr(part, "reach", 0) for part in (self.far, self.join))
        return [
            Step("reduced", (reads,), lambda x: self.layers[:2](self.level(x)), reach=4, stride=4),
            Step("further", ("reduced",), self.layers[2:], reach=4 * further, stride=4),
            Step("far", ("further",), self.far, reach=-(-4 * far // self.stride) * self.stride, stride=4),
            Step(gives, ("far",), lambda y: self.last(self.level(self.join(y))), reach=4 * join, stride=4),
        ]


def with_quarter(x: Float[Tensor, "b c h w"], y: Float[Tensor, "b c i j"]) -> Float[Tensor, "b c h w"]:
    """What was seen at a quarter of the resolution added; a pixel takes it from at most two quarter pixels around."""
    return x + F.interpolate(y, scale_factor=4, mode="bilinear")
