"""Random sample consensus over triplets: Y. Mukaigawa, Y. Ishii, T. Shakunaga, JOSA A 24(10), 2007."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.triplets import conditioned_triplets, hypotheses
from photonormal.methods.classical.woodham import weighted_normals
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.options import Effort, Positive, Seed, Whole
from photonormal.shading import cosines, normalised


@dataclass(frozen=True)
class Ransac:
    """The triplet of lights whose normal explains most lit samples of the pixel, refined on the samples it explains.

    Exact while more samples agree on the matt normal than on any other. Needs 4 lights.

    Parameters
    ----------
    tolerance : residual of an explained sample, relative to the pixel's median lit sample
    triplets : number of hypotheses
    refits : linear fits to the explained samples
    seed : of the hypotheses' choice
    """

    tolerance: Positive = 0.05
    triplets: Effort = 100
    refits: Whole = 3
    seed: Seed = 0

    needs: ClassVar[Needs] = Needs(images=4)

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.fit(seen.I, seen.keep, seen.lights))

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        usual = I.masked_fill(~keep, torch.nan).nanmedian(dim=1, keepdim=True).values.nan_to_num(0)
        within = self.tolerance * usual.clamp(min=1e-12)  # (p, 1)

        def outside(b: Tensor) -> Tensor:  # (p, n): squared residual in units of the tolerance, at most 1
            return ((I - cosines(b, L)) / within).square_().clamp_(max=1)

        triplets = conditioned_triplets(L, self.triplets, self.seed)
        candidates = hypotheses(I, L, triplets)  # (p, t, 3)
        best = torch.zeros_like(candidates[:, 0])
        least = torch.full_like(within, torch.inf)
        lit = keep.to(I.dtype)
        for b in candidates.unbind(1):
            loss = (outside(b) * lit).sum(1, keepdim=True)
            best = torch.where(loss < least, b, best)
            least = torch.minimum(loss, least)
        for _ in range(self.refits):
            best = weighted_normals(I, lit * (outside(best) < 1), L)
        return normalised(best)
