"""Some pixels at a time: blocks whose samples suit the device."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.methods.inputs.workers import side_by_side

BLOCK = {"cpu": 2**18, "cuda": 2**22}  # samples solved at a time: bounds memory; on the processor they fit its cache


def blocks(p: int, n: int, device: torch.device) -> Iterator[slice]:
    """Slices of `p` pixels under `n` lights, each of a size that suits the device."""
    step = max(1, BLOCK[device.type if device.type in BLOCK else "cpu"] // n)
    return (slice(start, start + step) for start in range(0, p, step))


def every_pixel(
    fit: Callable[[Tensor, Tensor, Tensor], Tensor],
    I: Float[Tensor, "p n"],
    keep: Bool[Tensor, "p n"],
    L: Float[Tensor, "*l n 3"],
) -> Float[Tensor, "p 3"]:
    """``fit(I, keep, L)`` of blocks side by side, in the precision and on the device of the lights."""

    def found(s: slice) -> Tensor:
        return fit(I[s].to(L), keep[s].to(L.device), seen_from(L, s))

    return torch.cat(side_by_side(found, blocks(I.shape[0], I.shape[1], L.device), L.device))


def seen_from(L: Float[Tensor, "*l n 3"], some: slice | Tensor) -> Float[Tensor, "*q n 3"]:
    """The lights of some pixels: their own, or those that all share."""
    return L if L.ndim == 2 else L[some]


def some_pixels(p: int, count: int) -> Int[Tensor, " q"]:
    """At most `count` of `p` pixels, at random, the same ones each time."""
    return torch.randperm(p, generator=torch.Generator().manual_seed(0))[:count].sort().values
