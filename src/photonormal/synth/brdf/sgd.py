"""Shifted gamma distribution: M. Bagher, C. Soler, N. Holzschuch, Computer Graphics Forum 31(4), 2012."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

PARAMETERS = ("rho_d", "rho_s", "alpha", "p", "f0", "f1", "kappa", "lambda", "c", "k", "theta0")  # as in the table


@dataclass(frozen=True)
class SGD:
    """Eleven parameters per channel: `values` is (..., 11, 3, p or 1) in the order of PARAMETERS."""

    values: Float[Tensor, "*b 11 3 p"]

    def diffuse(self) -> Float[Tensor, "*b 3 p"]:
        """rho_d: albedo of the matt part."""
        return self.values[..., 0, :, :]

    def specular(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "*n 3 p"]:
        """The glossy part of f: rho_s F(theta_d) D(theta_h) G(theta_l) G(theta_v) / (pi cos_l cos_v)."""
        _, rho_s, alpha, p, f0, f1, kappa, lam, c, k, theta0 = self.values.unbind(-3)  # (..., 3, p)
        cl, cv, ch, cd = (x.unsqueeze(-2) for x in (cos_l, cos_v, cos_h, cos_d))

        def G(cos: Tensor) -> Tensor:
            beyond = (torch.acos(cos.clamp(0, 1)) - theta0).clamp(min=0)
            return (1 + lam * (1 - torch.exp(c * beyond**k))).clamp(0, 1)

        cos2 = ch.square().clamp(min=1e-4)
        a = alpha + (1 / cos2 - 1) / alpha
        D = kappa * torch.exp(-a - p * torch.log(a)) / (math.pi * cos2.square())
        F = (f0 - cd * f1 + (1 - cd) ** 5 * (1 - f0)).clamp(min=0)
        return rho_s * F * D * G(cl) * G(cv) / (math.pi * (cl * cv).clamp(min=1e-4))

    def __call__(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "*n 3 p"]:
        return self.diffuse() / math.pi + self.specular(cos_l, cos_v, cos_h, cos_d)
