"""Sparse residuals: S. Ikehata, D. Wipf, Y. Matsushita, K. Aizawa, CVPR 2012, its convex (L1) form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.woodham import weighted_normals
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.inputs.grey import lit
from photonormal.options import Effort, Positive
from photonormal.shading import cosines, normalised


@dataclass(frozen=True)
class L1:
    """b = argmin sum_j |l_j.b - I_j| over the lit samples, by reweighted least squares.

    Exact while fewer than about a third of the samples of a matt pixel are highlights or shadows. Needs 4 lights.

    Parameters
    ----------
    steps : reweightings
    smallest : residual, relative to the pixel's brightest sample, below which weights grow no more
    """

    steps: Effort = 30
    smallest: Positive = 1e-4

    needs: ClassVar[Needs] = Needs(images=4)

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.fit(seen.I, seen.keep, seen.lights))

    def normals(
        self, I: Float[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"], dark: float | None = None
    ) -> Float[Tensor, "*b p 3"]:
        """Unit normals from grey levels and lights; leading batch dimensions are allowed. `dark`: see `Prior`."""
        return self.fit(I, lit(I, dark), L)

    def fit(
        self, I: Float[Tensor, "*b p n"], keep: Bool[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "*b p 3"]:
        """Unit normals from the samples to `keep`."""
        keep = keep.to(I.dtype)
        smallest = (self.smallest * I.amax(-1, keepdim=True)).clamp(min=1e-12)
        b = weighted_normals(I, keep, L)
        for _ in range(self.steps):
            r = (I - cosines(b, L)).abs()  # (*b, p, n)
            b = weighted_normals(I, keep / torch.maximum(r, smallest), L)
        return normalised(b)
