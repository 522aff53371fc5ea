"""The ABC microfacet model: J. Löw, J. Kronander, A. Ynnerman, J. Unger, ACM Transactions on Graphics 31(1), 2012."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

PARAMETERS = ("kd_r", "kd_g", "kd_b", "a_r", "a_g", "a_b", "b", "c", "ior")  # as in the table


@dataclass(frozen=True)
class ABC:
    """Nine parameters: `values` is (..., 9, p or 1) in the order of PARAMETERS."""

    values: Float[Tensor, "*b 9 p"]

    def diffuse(self) -> Float[Tensor, "*b 3 p"]:
        """k_d: albedo of the matt part."""
        return self.values[..., 0:3, :]

    def specular(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "*n 3 p"]:
        """The glossy part of f: F(theta_d) D(theta_h) G / (pi cos_l cos_v), D = A / (1 + B (1 - cos_h))^C."""
        A = self.values[..., 3:6, :]
        B, C, ior = self.values[..., 6:, :].unbind(-2)
        D = torch.exp(-C * torch.log1p(B * (1 - cos_h).clamp(min=0)))
        G = 2 * cos_h * torch.minimum(cos_l, cos_v) / cos_d.clamp(min=1e-3)
        G = G.clamp(0, 1) * fresnel(cos_d, ior) / (math.pi * (cos_l * cos_v).clamp(min=1e-4))
        return A * (D * G).unsqueeze(-2)

    def __call__(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "*n 3 p"]:
        return self.diffuse() / math.pi + self.specular(cos_l, cos_v, cos_h, cos_d)


def fresnel(cos_d: Tensor, ior: Tensor) -> Tensor:
    """Unpolarised reflectance of a dielectric surface."""
    g = (ior.square() + cos_d.square() - 1).clamp(min=1e-6).sqrt()
    a, s = (g - cos_d) / (g + cos_d), g + cos_d
    b = (cos_d * s - 1) / (cos_d * (g - cos_d) + 1)
    return 0.5 * a.square() * (1 + b.square())
