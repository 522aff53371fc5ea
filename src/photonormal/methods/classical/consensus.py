"""Consensus of constraints: T. Higo, Y. Matsushita, K. Ikeuchi, CVPR 2010."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.geometry import fibonacci_hemisphere
from photonormal.methods.classical.triplets import by_direction
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.inputs.blocks import seen_from
from photonormal.options import Angle, Effort, NotNegative, Positive
from photonormal.shading import normalised, over_lights

TOGETHER, ALONE = 512, 16  # pixels voted on at a time; where each sees the lights elsewhere


@dataclass(frozen=True)
class Consensus:
    """Candidate normals over the hemisphere, each with the votes of all pairs of lit samples; the mean of the best.

    Monotonicity: I_i > I_j asks for n.(l_i - l_j) > 0, for any reflectance that grows with n.l. Visibility: a lit
    sample asks for n.l > 0. No reflectance is fitted, so it holds on metal, but the answer is a region as wide as the
    lights are sparse. Needs 6 lights.

    Parameters
    ----------
    coarse, fine : candidates on the hemisphere; the fine ones are voted on around the best coarse one only
    reach_deg : how far around under 48 lights or more, degrees; fewer lights leave wider regions
    pairs : pairs of lights that vote, at most: of more lights than 89 they are drawn with a fixed seed
    noise : relative difference of two samples below which their vote fades
    visible : votes that a lit sample on the dark side takes away, in units of the number of lights
    tie : share of all votes within which candidates count as equal
    """

    coarse: Effort = 400
    fine: Effort = 20000
    reach_deg: Angle = 8.0
    pairs: Effort = 4000
    noise: Positive = 0.01
    visible: Positive = 2.5
    tie: NotNegative = 0.003

    needs: ClassVar[Needs] = Needs(images=6)

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.fit(seen.I, seen.keep, seen.lights))

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        pairs = by_direction(L)[drawn_pairs(L.shape[-2], self.pairs)].to(L.device)
        coarse = hemisphere(self.coarse, L)  # (m, 3)
        near = (self.best(I, keep, L, coarse, pairs) @ coarse.T).argmax(1)  # (p,)
        fine = hemisphere(self.fine, L)
        reach_deg = min(45.0, self.reach_deg * max(1.0, 48 / I.shape[1]))
        reached = coarse @ fine.T > np.cos(np.radians(reach_deg))
        N = torch.zeros_like(I[:, :3])
        for cell in near.unique().tolist():  # pixels of one coarse candidate share the fine ones
            p = torch.nonzero(near == cell)[:, 0]
            N[p] = self.best(I[p], keep[p], seen_from(L, p), fine[reached[cell]], pairs)
        return N * (keep.sum(1, keepdim=True) >= 3)

    def best(
        self,
        I: Float[Tensor, "p n"],
        keep: Bool[Tensor, "p n"],
        L: Float[Tensor, "*l n 3"],
        C: Float[Tensor, "m 3"],
        pairs: Int[Tensor, "2 k"],
    ) -> Float[Tensor, "p 3"]:
        """The mean of the candidates with the most votes."""
        found = []
        for s in chunks(I, L):
            score, cast = self.votes(I[s], keep[s], seen_from(L, s), C, pairs)
            tied = score >= score.amax(1, keepdim=True) - self.tie * cast
            found.append(tied.to(I.dtype) @ C)
        return normalised(torch.cat(found))

    def votes(
        self,
        I: Float[Tensor, "p n"],
        keep: Bool[Tensor, "p n"],
        L: Float[Tensor, "*l n 3"],
        C: Float[Tensor, "m 3"],
        pairs: Int[Tensor, "2 k"],
    ) -> tuple[Float[Tensor, "p m"], Float[Tensor, "p 1"]]:
        """Votes of each pixel for each candidate, and the number of votes cast."""
        i, j = pairs
        difference = I[:, i] - I[:, j]
        noise = self.noise * torch.maximum(I[:, i], I[:, j]).clamp(min=1e-9)
        w = (difference / noise).clamp_(-1, 1).mul_(keep[:, i] & keep[:, j])  # (p, pairs)
        cos = L @ C.T  # (*l, n, m)
        monotonic = over_lights(w, (cos[..., i, :] - cos[..., j, :]).sign())
        hidden = over_lights(keep.to(I.dtype), (cos <= 0).to(I.dtype))
        return monotonic - self.visible * I.shape[1] * hidden, w.abs().sum(1, keepdim=True)


@lru_cache(1)
def drawn_pairs(n: int, most: int) -> Int[Tensor, "2 k"]:
    """All pairs of n numbers, or `most` of them, drawn with a fixed seed."""
    pairs = torch.triu_indices(n, n, 1)
    if pairs.shape[1] > most:
        pairs = pairs[:, torch.randperm(pairs.shape[1], generator=torch.Generator().manual_seed(0))[:most]]
    return pairs


def hemisphere(m: int, like: Tensor) -> Float[Tensor, "m 3"]:
    """m directions spread over the hemisphere."""
    return torch.as_tensor(fibonacci_hemisphere(m), dtype=like.dtype, device=like.device)


def chunks(I: Float[Tensor, "p n"], L: Float[Tensor, "*l n 3"]) -> Iterator[slice]:
    """Some pixels at a time."""
    step = (TOGETHER if L.ndim == 2 else ALONE) * (1 if I.device.type == "cpu" else 32)
    return (slice(first, first + step) for first in range(0, len(I), step))
