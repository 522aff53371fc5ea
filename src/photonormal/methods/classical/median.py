"""Median of triplets: D. Miyazaki, K. Hara, K. Ikeuchi, IJCV 86(2-3), 2010."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.triplets import conditioned_triplets, hypotheses
from photonormal.methods.classical.woodham import scaled_normals
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.options import Effort, Seed
from photonormal.shading import normalised


@dataclass(frozen=True)
class Median:
    """Every well-conditioned triplet of lit samples gives a normal; the answer is their median, component by component.

    Exact while more than half of the triplets are matt. Needs 3 lights.

    Parameters
    ----------
    triplets : number of triplets
    seed : of their choice
    """

    triplets: Effort = 300
    seed: Seed = 0

    needs: ClassVar[Needs] = Needs()

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.fit(seen.I, seen.keep, seen.lights))

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        triplets = conditioned_triplets(L, self.triplets, self.seed)
        N = normalised(hypotheses(I, L, triplets))  # (p, t, 3)
        N = N.masked_fill(~keep[:, triplets].all(-1, keepdim=True), torch.nan)
        median = N.nanmedian(dim=1).values
        return normalised(torch.where(median.isfinite(), median, scaled_normals(I, L)))
