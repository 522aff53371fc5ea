"""What a network remembers of the images it has seen: the maximum and, where asked for, sums of their features.

Both can be taken image by image, so a measurement needs memory for one image, whatever their number.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor


class Pooled(NamedTuple):
    """Features of several images (b, k, ...) fused over k: any order, any portions."""

    maximum: Tensor  # (b, ...)
    total: Tensor | None = None  # (b, ...) float32 sum; None where the network asks for the maximum alone
    weighted: Tensor | None = None  # (b, ...) float32 sum of weighted features, or None
    weights: Tensor | None = None  # (b, ...) float32 sum of their weights

    def merged(self, other: Pooled) -> Pooled:
        """This and what other images gave; overwrites this one's memory, so only where no gradient is needed."""
        torch.maximum(self.maximum, other.maximum, out=self.maximum)
        for mine, added in zip(self[1:], other[1:], strict=True):
            if mine is not None and added is not None:
                mine.add_(added)
        return self


def pool(features: Float[Tensor, "b k *chw"], total: bool = False) -> Pooled:
    """Maximum, and sum if `total`, over the images k. Fast where the memory runs in the order of the axes."""
    if features.shape[1] == 1:  # nothing to fuse: measuring image by image
        return Pooled(features[:, 0], features[:, 0].to(torch.float32, copy=True) if total else None)
    if total:
        return Pooled(*MaximumAndTotal.apply(features))
    return Pooled(Maximum.apply(features))  # type: ignore[arg-type]


class Maximum(torch.autograd.Function):
    """Maximum over the second axis. Its gradient goes to every image that reaches it.

    torch.amax is as fast forward; backward it counts ties, which costs several passes over the largest tensor there is.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        maximum = x.amax(dim=1)  # (b, ...)
        ctx.save_for_backward(x, maximum)
        return maximum

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        x, maximum = ctx.saved_tensors
        return torch.where(x == maximum[:, None], gradients[0][:, None], 0)


class MaximumAndTotal(torch.autograd.Function):
    """Maximum and float32 sum over the second axis, with one write of the gradient for both."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> tuple[Tensor, Tensor]:
        maximum, total = x.amax(dim=1), x.sum(dim=1, dtype=torch.float32)  # (b, ...)
        ctx.save_for_backward(x, maximum)
        return maximum, total

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        x, maximum = ctx.saved_tensors
        to_all = gradients[1].to(x.dtype)  # (b, ...)
        return torch.where(x == maximum[:, None], (gradients[0] + to_all)[:, None], to_all[:, None])


def weighted_sum(features: Float[Tensor, "p k f"], weights: Float[Tensor, "p k g"]) -> Float[Tensor, "p f"]:
    """Float32 sums over the images k; each of g equal groups of features has its own weights.

    One matrix product a pixel, of all groups with all weights: faster than products of the size of all features.
    """
    every = torch.bmm(weights.mT, features).unflatten(2, (weights.shape[2], -1))  # (p, g, g, f / g)
    return every.diagonal(dim1=1, dim2=2).mT.flatten(1).float()
