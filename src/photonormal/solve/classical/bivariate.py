"""Constrained bivariate regression: S. Ikehata, K. Aizawa, CVPR 2014."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import comb

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.shading import cosines, over_lights
from photonormal.solve.classical.nonnegative import nonnegative_minimum
from photonormal.solve.classical.trimmed import Trimmed
from photonormal.solve.classical.woodham import pairs, symmetric_inverse
from photonormal.solve.observations import at_least, normalised, per_lit_pixel
from photonormal.types import Capture, Normals

SIX_TO_NINE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # xx xy xz yy yz zz -> 3 x 3


@dataclass(frozen=True)
class Bivariate:
    """n.l = g(I, v.l), the inverse of the reflectance: a Bernstein polynomial that grows with I from g(0, .) = 0.

    g = sum_kj d_kj (sum_{i>=k} B_i(I)) B_j(v.l) with d >= 0, so the normal and d minimise |L n - Phi d|^2, of which n
    is eliminated. Beyond the paper, the brightest samples are left out, g bends at a cost, and samples far from the fit
    lose weight (they are cast shadows and interreflections), round by round. Needs 6 lights.

    Parameters
    ----------
    degree_intensity, degree_light : degrees N1 and N2 of g in I and in v.l
    bend : cost of squared differences between neighbouring d, relative to the mean square of Phi
    spread : residual n.l - g that halves a sample's weight
    window : which samples enter
    start : gives the normal that the first weights rest on
    rounds : of reweighting
    """

    degree_intensity: int = 2
    degree_light: int = 1
    bend: float = 3e-3
    spread: float = 0.03
    window: Trimmed = field(default=Trimmed(lowest=0.0, highest=0.75, least=12))
    start: Trimmed = field(default=Trimmed())
    rounds: int = 5

    def __call__(self, capture: Capture, device: torch.device) -> Normals:
        at_least(6, capture, "bivariate")
        return per_lit_pixel(self.fit, capture, device, torch.float64)

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        start = self.start.fit(I, keep, L)
        keep = keep & self.window.window(I, keep)
        Phi = self.basis(I, keep, L)  # (p, n, m)
        bend = self.bending(Phi)
        w = keep.to(I.dtype) / (1 + (lambertian_residual(I, keep, cosines(start, L)) / 0.2) ** 2)
        n = start
        for _ in range(self.rounds):
            A, fixed = symmetric_inverse(over_lights(w, pairs(L)))  # of L'wL
            A = A[:, SIX_TO_NINE].unflatten(1, (3, 3))
            wPhi = w[..., None] * Phi
            LPhi = L.transpose(-1, -2) @ wPhi  # (p, 3, m)
            G = wPhi.transpose(1, 2) @ Phi - LPhi.transpose(1, 2) @ A @ LPhi  # of |L n - Phi d|^2 with the best n
            G = G / (wPhi * Phi).sum((1, 2)).div(Phi.shape[2]).clamp(min=1e-12)[:, None, None] + bend
            d = nonnegative_minimum(G, torch.ones_like(G[..., 0]))  # (p, m), up to scale
            b = (A @ LPhi @ d[..., None])[..., 0]
            r = (cosines(b, L) - (Phi @ d[..., None])[..., 0]) / b.norm(dim=-1, keepdim=True).clamp(min=1e-12)
            w = keep / (1 + (r / self.spread) ** 2)
            n = torch.where(fixed, normalised(b), n)
        return n

    def basis(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p n m"]:
        """(sum_{i>=k} B_i(y)) B_j(x): y is I over the pixel's brightest sample to `keep`, x is v.l from 0 to 1."""
        y = (I / (I * keep).amax(1, keepdim=True).clamp(min=1e-12)).clamp(max=1)
        low, high = L[..., 2].amin(-1, keepdim=True), L[..., 2].amax(-1, keepdim=True)
        x = (L[..., 2] - low) / (high - low).clamp(min=1e-12)  # (*l, n)
        B = bernstein(y, self.degree_intensity)
        growing = [torch.stack(B[k:]).sum(0) for k in range(1, len(B))]
        return torch.stack([g * b for g in growing for b in bernstein(x, self.degree_light)], dim=-1)

    def bending(self, Phi: Float[Tensor, "p n m"]) -> Float[Tensor, "m m"]:
        """The quadratic form of the cost of bending, and a little to keep it definite."""
        k, j = self.degree_intensity, self.degree_light + 1
        index = torch.arange(k * j, device=Phi.device).reshape(k, j)
        unit = torch.eye(k * j, dtype=Phi.dtype, device=Phi.device)
        D = torch.cat([unit[index[1:].flatten()] - unit[index[:-1].flatten()],
                       unit[index[:, 1:].flatten()] - unit[index[:, :-1].flatten()]])  # fmt: skip
        return self.bend * D.T @ D + 1e-7 * unit


def bernstein(t: Float[Tensor, "*p"], degree: int) -> list[Float[Tensor, "*p"]]:
    """The degree + 1 Bernstein polynomials at t in [0, 1]."""
    return [comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)]


def lambertian_residual(
    I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], cos: Float[Tensor, "p n"]
) -> Float[Tensor, "p n"]:
    """I - albedo n.l with the best albedo, in units of the mean sample to `keep`."""
    albedo = (I * cos * keep).sum(1, keepdim=True) / (cos**2 * keep).sum(1, keepdim=True).clamp(min=1e-12)
    mean = (I * keep).sum(1, keepdim=True) / keep.sum(1, keepdim=True).clamp(min=1)
    return (I - albedo * cos) / mean.clamp(min=1e-12)
