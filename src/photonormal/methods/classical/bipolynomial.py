"""Bi-polynomial reflectance: B. Shi, P. Tan, Y. Matsushita, K. Ikeuchi, TPAMI 36(6), 2014."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.monotonic import Monotonic
from photonormal.methods.classical.trimmed import Trimmed
from photonormal.methods.classical.woodham import pairs, symmetric_inverse, symmetric_product
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.options import Degree, NotNegative, Whole
from photonormal.shading import cosines, half_vectors, normalised, over_lights


@dataclass(frozen=True)
class Bipolynomial:
    """rho(x, y) = sum_ij C_ij (1 - x)^i (1 - y)^j with x = n.h, y = l.h: the low-frequency part of an isotropic BRDF.

    Only samples of lower rank enter, so that no sharp highlight needs modelling. C and the normal are found in turn,
    each by linear least squares. A ridge on all but the constant keeps C from absorbing errors of the normal where the
    lights cover a narrow cone; on metal it is weaker, and the first normal is that of `monotonic`. Needs 6 lights.

    Parameters
    ----------
    degree : highest power of each of the two cosines
    ridge, ridge_metal : weight of C_ij^2, relative to that of the data on the constant term
    window : which samples enter, and the first normal
    metal : the first normal on metal
    rounds : of finding C, then the normal
    """

    degree: Degree = 2
    ridge: NotNegative = 3e-3
    ridge_metal: NotNegative = 1e-4
    window: Trimmed = field(default=Trimmed())
    metal: Monotonic = field(default=Monotonic())
    rounds: Whole = 6

    needs: ClassVar[Needs] = Needs(images=6, double=True)

    def __call__(self, seen: Observations) -> Solution:
        fit = self.fit_metal if seen.metallic() else self.fit
        return Solution(fit(seen.I, seen.keep, seen.lights))

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        return self.alternation(I, keep, L, self.window.fit(I, keep, L), self.ridge)

    def fit_metal(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """As `fit`, on metal."""
        start = self.metal.fit(I.float(), keep, L.float())
        return self.alternation(I, keep, L, start.to(I), self.ridge_metal)

    def alternation(
        self,
        I: Float[Tensor, "p n"],
        keep: Bool[Tensor, "p n"],
        L: Float[Tensor, "*l n 3"],
        n: Float[Tensor, "p 3"],
        weight: float,
    ) -> Float[Tensor, "p 3"]:
        """C and the normal in turn, from the normal `n` on, with a ridge of some weight."""
        w = (keep & self.window.window(I, keep)).to(I.dtype)  # (p, n)
        I = I * (w.sum(1, keepdim=True) / (w * I).sum(1, keepdim=True).clamp(min=1e-12))
        H = half_vectors(L)
        y = (1 - (L * H).sum(-1))[..., None]  # (*l, n, 1)
        i, j = torch.meshgrid(*2 * [torch.arange(self.degree + 1, device=L.device)], indexing="ij")
        i, j = i.flatten(), j.flatten()  # the m terms
        ridge = weight * (i + j > 0) + 1e-9
        for _ in range(self.rounds):
            cos = cosines(n, L).clamp(min=0)
            x = (1 - cosines(n, H))[..., None]
            terms = x**i * y**j  # (p, n, m)
            F = terms * (w * cos)[..., None]  # I = cos sum_ij C_ij x^i y^j
            G = F.transpose(1, 2) @ F
            G = G + torch.diag_embed(ridge * G[:, :1, 0].clamp(min=1e-9))
            C = torch.linalg.solve(G, (F * I[..., None]).sum(1))  # (p, m)
            rho = (terms @ C[..., None])[..., 0].clamp(min=1e-3)
            A, fixed = symmetric_inverse(over_lights(w * rho**2, pairs(L)))  # I = rho l.b
            n = torch.where(fixed, normalised(symmetric_product(A, over_lights(w * rho * I, L))), n)
        return n
