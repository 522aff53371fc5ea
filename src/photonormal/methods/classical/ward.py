"""Mixtures of Ward materials: D. Goldman, B. Curless, A. Hertzmann, S. Seitz, TPAMI 32(6), 2010."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import pi
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.alternation import Alternation
from photonormal.methods.classical.nonnegative import nonnegative_minimum
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.inputs.blocks import seen_from
from photonormal.shading import cosines, half_vectors, shade

DESCENT = 30  # steps of fitting the materials
SPREAD = 0.1  # residual beyond which a sample loses weight in that
ROUGHNESS = (-3.0, -0.5)  # log alpha stays within; narrower lobes are met by single samples


@dataclass(frozen=True)
class Ward:
    """I = n.l sum_m gamma_pm f_m, f_m = rho_d / pi + rho_s exp(-tan^2 delta / alpha^2) / (4 pi alpha^2 sqrt(n.l n.v)).

    Few isotropic Ward materials f_m for the object (delta is the angle between n and h), non-negative shares gamma and
    a normal for each pixel, found in turn. Needs 10 lights.

    Parameters
    ----------
    diffuse, specular, roughness : rho_d, rho_s, alpha that the materials start from
    alternation : of fitting materials, then normals
    """

    diffuse: tuple[float, ...] = (1.0, 0.3)
    specular: tuple[float, ...] = (0.1, 1.0)
    roughness: tuple[float, ...] = (0.15, 0.4)
    alternation: Alternation = field(default=Alternation(sample=400, rounds=3))

    needs: ClassVar[Needs] = Needs(images=10, reads="object", optimises=True)

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.alternation(self.materials, seen))

    def materials(self, L: Float[Tensor, "*l n 3"]) -> WardMaterials:
        """The materials to start from."""
        rho_d, rho_s, alpha = (L.new_tensor(x).log() for x in (self.diffuse, self.specular, self.roughness))
        return WardMaterials(rho_d, rho_s, alpha, L)


@dataclass(frozen=True)
class WardMaterials:
    """Ward materials, as logarithms of their parameters, under lights L."""

    rho_d: Float[Tensor, " m"]
    rho_s: Float[Tensor, " m"]
    alpha: Float[Tensor, " m"]
    L: Float[Tensor, "*l n 3"]

    def radiance(self, n: Float[Tensor, "p 3"]) -> Float[Tensor, "p m n"]:
        """n.l f_m of each material."""
        rho_d, rho_s, alpha = (x.exp()[:, None] for x in (self.rho_d, self.rho_s, self.alpha))  # (m, 1)
        cos = cosines(n, self.L).clamp(min=1e-3)[:, None]  # (p, 1, n)
        cos_v = n[:, 2].clamp(min=0.05)[:, None, None]
        cos_h2 = cosines(n, half_vectors(self.L)).clamp(min=1e-3)[:, None] ** 2
        tan_h2 = (1 - cos_h2).clamp(min=0) / cos_h2
        lobe = torch.exp(-tan_h2 / alpha**2) / (4 * pi * alpha**2 * (cos * cos_v).clamp(min=0.02).sqrt())
        return shade(rho_d / pi + rho_s * lobe, cos)

    def model(
        self, some: slice, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], n: Float[Tensor, "p 3"]
    ) -> Callable[[Tensor], Tensor]:
        """n.l sum_m gamma_m f_m as a function of the normals, with the shares gamma that suit the present ones."""
        here = replace(self, L=seen_from(self.L, some))
        gamma = shares(here.radiance(n), I, keep)
        return lambda n: (gamma[..., None] * here.radiance(n)).sum(1)

    def fitted(
        self, some: Tensor, I: Float[Tensor, "q n"], keep: Bool[Tensor, "q n"], n: Float[Tensor, "q 3"]
    ) -> WardMaterials:
        """Materials that explain the samples best: gradient descent with shares found anew at each step."""
        w = keep.to(I.dtype)
        root = (I / ((I * w).sum(1, keepdim=True) / w.sum(1, keepdim=True).clamp(min=1)).clamp(min=1e-9)).sqrt()
        rho_d, rho_s, alpha = log = [x.clone().requires_grad_() for x in (self.rho_d, self.rho_s, self.alpha)]
        descent, L = torch.optim.Adam(log, lr=0.1), seen_from(self.L, some)
        I = root**2
        with torch.enable_grad():
            for _ in range(DESCENT):
                f = WardMaterials(rho_d, rho_s, alpha, L).radiance(n)
                gamma = shares(f.detach(), I, keep)
                r = root - (gamma[..., None] * f).sum(1).clamp(min=1e-9).sqrt()
                loss = (w * torch.log1p((r / SPREAD) ** 2)).sum() / w.sum().clamp(min=1)
                descent.zero_grad()
                loss.backward()
                descent.step()
                with torch.no_grad():
                    alpha.clamp_(*ROUGHNESS)
        return WardMaterials(rho_d.detach(), rho_s.detach(), alpha.detach(), self.L)


def shares(f: Float[Tensor, "p m n"], I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"]) -> Float[Tensor, "p m"]:
    """Non-negative gamma of I = sum_m gamma_m f_m; weighted as residuals of roots are."""
    w = keep.to(I.dtype)
    mean = (I * w).sum(1, keepdim=True) / w.sum(1, keepdim=True).clamp(min=1)
    w = w / (I + 0.1 * mean).clamp(min=1e-9)
    G = (f * w[:, None]) @ f.transpose(1, 2)  # (p, m, m)
    c = (f * (w * I)[:, None]).sum(2)
    size = G.diagonal(dim1=1, dim2=2).sqrt().clamp(min=1e-12)  # (p, m)
    G = G / (size[:, :, None] * size[:, None]) + 1e-4 * torch.eye(G.shape[1], device=G.device)
    return nonnegative_minimum(G.double(), (c / size).double()).to(f.dtype) / size
