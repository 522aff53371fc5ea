"""A principled family that needs no measurement: B. Burley, Physically based shading at Disney, SIGGRAPH 2012."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.shading import ggx, schlick, smith

PARAMETERS = (
    "base_r", "base_g", "base_b", "metallic", "roughness", "specular", "tint", "sheen", "sheen_tint", "coat", "gloss",
)  # fmt: skip


@dataclass(frozen=True)
class Principled:
    """Eleven parameters in [0, 1], `specular` up to 4: `values` is (..., 11, p or 1) in the order of PARAMETERS."""

    values: Float[Tensor, "*b 11 p"]

    def base(self) -> Float[Tensor, "*b 3 p"]:
        """Base colour."""
        return self.values[..., 0:3, :]

    def matt(self, cos_l: Tensor, cos_v: Tensor, cos_d: Tensor) -> Float[Tensor, "*n p"]:
        """Burley's diffuse lobe over (base / pi): brighter at the rim of rough surfaces, darker of smooth ones."""
        metallic, rough = self.values[..., 3, :], self.values[..., 4, :]
        F90 = 2 * rough * cos_d.square() - 0.5  # - 1
        return (1 - metallic) * (1 + F90 * (1 - cos_l) ** 5) * (1 + F90 * (1 - cos_v) ** 5)

    def specular(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "*n 3 p"]:
        """GGX highlight, tinted on metals, with sheen and a clear coat; one roughness for facets and their masking."""
        base = self.base()
        metallic, rough, spec, tint, sheen, sheen_tint, coat, gloss = self.values[..., 3:, :].unbind(-2)
        hue = base / (base * base.new_tensor([0.3, 0.6, 0.1])[:, None]).sum(-2, keepdim=True).clamp(min=1e-3)
        dielectric = 0.08 * spec.unsqueeze(-2) * torch.lerp(torch.ones_like(hue), hue, tint.unsqueeze(-2))
        F0 = torch.lerp(dielectric.clamp(max=1), base, metallic.unsqueeze(-2))  # (..., 3, p)
        F = schlick(cos_d)
        a2 = rough.square().clamp(min=1e-3).square()
        lobe = ggx(cos_l, cos_v, cos_h, a2)  # (..., p)
        out = torch.addcmul(F0, 1 - F0, F.unsqueeze(-2)).mul_(lobe.unsqueeze(-2))  # (..., 3, p)
        if bool((coat > 0).any()):
            c2 = torch.lerp(torch.full_like(gloss, 0.1), torch.full_like(gloss, 0.01), gloss).square()
            c = (c2 - 1) / (math.pi * torch.log(c2) * (1 + (c2 - 1) * cos_h.square()))
            c = 0.25 * coat * c * (0.04 + 0.96 * F) * smith(cos_l, 0.0625) * smith(cos_v, 0.0625)
            out += c.unsqueeze(-2)
        if bool((sheen > 0).any()):
            colour = torch.lerp(torch.ones_like(hue), hue, sheen_tint.unsqueeze(-2))
            out.addcmul_(((1 - metallic) * sheen).unsqueeze(-2) * colour, F.unsqueeze(-2))
        return out

    def __call__(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "*n 3 p"]:
        matt = self.matt(cos_l, cos_v, cos_d).unsqueeze(-2) / math.pi
        return torch.addcmul(self.specular(cos_l, cos_v, cos_h, cos_d), self.base(), matt)
