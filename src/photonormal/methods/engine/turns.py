"""Quarter turns of what a network is shown, and back."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.methods.learned.layers import unit


def turned(v: Tensor, quarters: int, axis: int) -> Tensor:
    """Vectors along `axis` turned about the view axis, counter-clockwise by quarter turns; from z on all stays."""
    if quarters % 4 == 0:
        return v
    x, y, *rest = v.unbind(axis)
    for _ in range(quarters % 4):
        x, y = -y, x
    return torch.stack([x, y, *rest], axis)


def turned_picture(v: Float[Tensor, "*b d h w"], quarters: int) -> Float[Tensor, "*b d i j"]:
    """A picture of numbers, turned; itself where it is not, since a copy would lie otherwise in memory."""
    return torch.rot90(v, quarters, (-2, -1)) if quarters % 4 else v


def turned_map(v: Float[Tensor, "*b d h w"], quarters: int) -> Float[Tensor, "*b d i j"]:
    """A map of vectors, turned as a picture is: where they are, and where they point."""
    return turned(turned_picture(v, quarters), quarters, -3)


def mean(told: Iterable[Float[Tensor, "1 d h w"]]) -> Float[Tensor, "1 d h w"]:
    """The mean of what several turns give; unit normals."""
    total, turns = torch.zeros(()), 0
    for one in told:
        total, turns = total + one, turns + 1
    return torch.cat([unit(total[:, :3]), total[:, 3:] / turns], dim=1)
