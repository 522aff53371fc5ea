"""Sparse Bayesian regression: S. Ikehata, D. Wipf, Y. Matsushita, K. Aizawa, CVPR 2012 (called "rank 3" in tables)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.woodham import pairs, scaled_normals, symmetric_inverse, symmetric_product
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.options import Effort, Positive
from photonormal.shading import cosines, normalised, over_lights


@dataclass(frozen=True)
class SBL:
    """I = L b + e + noise, where every sample has its own variance gamma_j of the outlier e_j, found by EM.

    Most gamma_j go to zero: those samples are Lambertian. Sparser than L1 on broad highlights. Needs 4 lights.

    Parameters
    ----------
    noise : variance lambda of the noise, at grey levels whose brightest sample in the pixel is 1
    steps : EM rounds
    """

    noise: Positive = 1e-4
    steps: Effort = 40

    needs: ClassVar[Needs] = Needs(images=4)

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.fit(seen.I, seen.keep, seen.lights))

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        lam = self.noise
        lit = keep.to(I.dtype)
        I = I / I.amax(-1, keepdim=True).clamp(min=1e-12)
        gamma = torch.ones_like(I)
        b = plain = scaled_normals(I, L)
        LL = pairs(L)  # (*l, n, 6)
        twice = LL.new_tensor([1, 2, 2, 1, 2, 1])  # a symmetric quadratic form meets its off-diagonals twice
        for _ in range(self.steps):
            w = lit / (gamma + lam)  # (p, n)
            cov, fixed = symmetric_inverse(over_lights(w, LL))  # posterior covariance of b, (p, 6)
            b = torch.where(fixed, symmetric_product(cov, over_lights(w * I, L)), plain)
            gw = gamma.mul_(w)  # share of each residual that the outlier takes
            q = over_lights(cov.to(I.dtype) * twice, LL.transpose(-1, -2))  # l_j.cov.l_j
            e = gw * (I - cosines(b, L))
            gamma = (e * e + lam * gw + gw * gw * q).clamp_(min=1e-12)
        return normalised(b)
