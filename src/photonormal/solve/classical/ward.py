"""Mixtures of Ward materials: D. Goldman, B. Curless, A. Hertzmann, S. Seitz, TPAMI 32(6), 2010."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.shading import cosines, half_vectors, shade
from photonormal.solve.classical.monotonic import Monotonic
from photonormal.solve.classical.nonnegative import nonnegative_minimum
from photonormal.solve.classical.ransac import Ransac
from photonormal.solve.classical.refine import Refinement
from photonormal.solve.observations import (
    at_least,
    blocks,
    every_pixel,
    grey_levels,
    lights_of,
    lit,
    on_mask,
    seen_from,
    some_pixels,
)
from photonormal.types import Capture, Normals

DESCENT = 30  # steps of fitting the materials
SPREAD = 0.1  # residual beyond which a sample loses weight in that
ROUGHNESS = (-3.0, -0.5)  # log alpha stays within; narrower lobes are met by single samples

Materials = tuple[Tensor, Tensor, Tensor]  # log rho_d, log rho_s, log alpha, each (m,)


@dataclass(frozen=True)
class Ward:
    """I = n.l sum_m gamma_pm f_m, f_m = rho_d / pi + rho_s exp(-tan^2 delta / alpha^2) / (4 pi alpha^2 sqrt(n.l n.v)).

    Few isotropic Ward materials f_m for the object (delta is the angle between n and h), non-negative shares gamma and
    a normal for each pixel, found in turn. That is done from two starts, one that is right on matt surfaces and one
    that is right on metal; each pixel keeps the answer that explains it better. Needs 10 lights.

    Parameters
    ----------
    diffuse, specular, roughness : rho_d, rho_s, alpha that the materials start from
    sample : pixels that the materials are fitted to
    rounds : of fitting materials, then shares, then normals
    matt, metal : give the two starts
    refinement : of the normals
    """

    diffuse: tuple[float, ...] = (1.0, 0.3)
    specular: tuple[float, ...] = (0.1, 1.0)
    roughness: tuple[float, ...] = (0.15, 0.4)
    sample: int = 400
    rounds: int = 3
    matt: Ransac = field(default=Ransac(triplets=60))
    metal: Monotonic = field(default=Monotonic())
    refinement: Refinement = field(default=Refinement())

    def __call__(self, capture: Capture, device: torch.device) -> Normals:
        at_least(10, capture, "ward")
        I = grey_levels(capture)  # (p, n)
        L = lights_of(capture, device)
        return on_mask(self.fit(I, lit(I), L).cpu(), capture)

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals of a whole object from the samples to `keep`; computed where the lights are."""
        answers = [self.refine(I, keep, L, start) for start in (self.matt, self.metal)]
        (n, loss), (n_metal, loss_metal) = answers
        return torch.where(loss_metal < loss, n_metal, n)

    def refine(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"], start: Ransac | Monotonic
    ) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 1"]]:
        """Normals from one start, and their loss."""
        n = every_pixel(start.fit, I, keep, L)
        loss = torch.zeros_like(n[:, :1])
        some = some_pixels(I.shape[0], self.sample)
        samples, lit = I[some].to(L), keep[some].to(L)
        materials = (
            L.new_tensor(self.diffuse).log(),
            L.new_tensor(self.specular).log(),
            L.new_tensor(self.roughness).log(),
        )
        for _ in range(self.rounds):
            materials = fitted(materials, samples, lit, n[some.to(L.device)], seen_from(L, some.to(L.device)))
            for s in blocks(I.shape[0], I.shape[1], L.device):
                block, kept, seen = I[s].to(L), keep[s].to(L.device), seen_from(L, s)
                gamma = shares(radiance(materials, n[s], seen), block, kept.to(L.dtype))

                def model(n: Tensor, L: Tensor = seen, M: Materials = materials, gamma: Tensor = gamma) -> Tensor:
                    return (gamma[..., None] * radiance(M, n, L)).sum(1)

                n[s], loss[s] = self.refinement(model, block, kept, n[s])
        return n, loss


def radiance(materials: Materials, n: Float[Tensor, "p 3"], L: Float[Tensor, "*l n 3"]) -> Float[Tensor, "p m n"]:
    """n.l f_m of each material."""
    rho_d, rho_s, alpha = (x.exp()[:, None] for x in materials)  # (m, 1)
    cos = cosines(n, L).clamp(min=1e-3)[:, None]  # (p, 1, n)
    cos_v = n[:, 2].clamp(min=0.05)[:, None, None]
    cos_h2 = cosines(n, half_vectors(L)).clamp(min=1e-3)[:, None] ** 2
    tan_h2 = (1 - cos_h2).clamp(min=0) / cos_h2
    lobe = torch.exp(-tan_h2 / alpha**2) / (4 * pi * alpha**2 * (cos * cos_v).clamp(min=0.02).sqrt())
    return shade(rho_d / pi + rho_s * lobe, cos)


def shares(f: Float[Tensor, "p m n"], I: Float[Tensor, "p n"], w: Float[Tensor, "p n"]) -> Float[Tensor, "p m"]:
    """Non-negative gamma of I = sum_m gamma_m f_m; weighted as residuals of roots are."""
    mean = (I * w).sum(1, keepdim=True) / w.sum(1, keepdim=True).clamp(min=1)
    w = w / (I + 0.1 * mean).clamp(min=1e-9)
    G = (f * w[:, None]) @ f.transpose(1, 2)  # (p, m, m)
    c = (f * (w * I)[:, None]).sum(2)
    size = G.diagonal(dim1=1, dim2=2).sqrt().clamp(min=1e-12)  # (p, m)
    G = G / (size[:, :, None] * size[:, None]) + 1e-4 * torch.eye(G.shape[1], device=G.device)
    return nonnegative_minimum(G.double(), (c / size).double()).to(f.dtype) / size


def fitted(
    materials: Materials,
    I: Float[Tensor, "q n"],
    w: Float[Tensor, "q n"],
    n: Float[Tensor, "q 3"],
    L: Float[Tensor, "*l n 3"],
) -> Materials:
    """Materials that explain the samples best, given normals: gradient descent with shares found anew at each step."""
    root = (I / ((I * w).sum(1, keepdim=True) / w.sum(1, keepdim=True).clamp(min=1)).clamp(min=1e-9)).sqrt()
    log = [x.clone().requires_grad_() for x in materials]
    descent = torch.optim.Adam(log, lr=0.1)
    I = root**2
    with torch.enable_grad():
        for _ in range(DESCENT):
            f = radiance((log[0], log[1], log[2]), n, L)
            gamma = shares(f.detach(), I, w)
            r = root - (gamma[..., None] * f).sum(1).clamp(min=1e-9).sqrt()
            loss = (w * torch.log1p((r / SPREAD) ** 2)).sum() / w.sum().clamp(min=1)
            descent.zero_grad()
            loss.backward()
            descent.step()
            with torch.no_grad():
                log[2].clamp_(*ROUGHNESS)
    return log[0].detach(), log[1].detach(), log[2].detach()
