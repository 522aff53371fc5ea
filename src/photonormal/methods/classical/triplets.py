"""Triplets of lights: each gives an exact Lambertian normal, the hypotheses of `median` and `ransac`."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

DRAWN = 8  # triplets drawn for each one kept


def conditioned_triplets(L: Float[Tensor, "*l n 3"], count: int, seed: int) -> Int[Tensor, "t 3"]:
    """Indices of at most `count` triplets of lights that span three dimensions best, of random ones or of all.

    Lights are ranked by direction first, so that the order of the images does not matter.
    """
    order = by_direction(L)
    L = common(L)
    n = L.shape[0]
    if n * (n - 1) * (n - 2) // 6 <= DRAWN * count:
        triplets = torch.combinations(torch.arange(n), 3)
    else:
        draw = torch.rand(DRAWN * count, n, generator=torch.Generator().manual_seed(seed))
        triplets = draw.topk(3, dim=1).indices
    triplets = order[triplets].to(L.device)
    volume = torch.linalg.det(L[triplets].double()).abs()
    best = volume.argsort(descending=True)[:count]
    return triplets[best[volume[best] > 1e-3]]


def common(L: Float[Tensor, "*l n 3"]) -> Float[Tensor, "n 3"]:
    """One direction of each light for all pixels: their mean where they see it elsewhere."""
    return L if L.ndim == 2 else L.mean(0)


def by_direction(L: Float[Tensor, "*l n 3"]) -> Int[Tensor, " n"]:
    """The lights in an order that depends on their directions alone."""
    return torch.tensor(sorted(range(L.shape[-2]), key=common(L).tolist().__getitem__))


def hypotheses(
    I: Float[Tensor, "p n"], L: Float[Tensor, "*l n 3"], triplets: Int[Tensor, "t 3"]
) -> Float[Tensor, "p t 3"]:
    """b = [l1 l2 l3]^-1 (I1 I2 I3) for each pixel and triplet."""
    inverse = torch.linalg.inv(L[..., triplets, :].double()).to(I.dtype)  # (*l, t, 3, 3)
    return torch.einsum("...tij,...tj->...ti", inverse, I[:, triplets])
