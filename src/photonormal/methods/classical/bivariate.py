"""Constrained bivariate regression: S. Ikehata, K. Aizawa, CVPR 2014."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import comb
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.nonnegative import nonnegative_minimum
from photonormal.methods.classical.trimmed import Trimmed
from photonormal.methods.classical.woodham import pairs, symmetric_inverse
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.inputs.grey import ascending_order
from photonormal.options import Degree, NotNegative, Positive, Whole
from photonormal.shading import cosines, half_vectors, normalised, over_lights

SIX_TO_NINE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # xx xy xz yy yz zz -> 3 x 3
TINY = 1e-7


@dataclass(frozen=True)
class Bivariate:
    """n.l = g(I, v.l), the inverse of the reflectance: a Bernstein polynomial that grows with I from g(0, .) = 0.

    g = sum_kj d_kj (sum_{i>=k} B_i(I)) B_j(v.l) with d >= 0, so the normal and d minimise |L n - Phi d|^2, of which n
    is eliminated. Beyond the paper, the brightest samples are left out, g bends at a cost, and samples far from the fit
    lose weight (they are cast shadows and interreflections), round by round. Pure metal has no part that follows n.l:
    there n.h = g(sqrt I) is fitted, too, and each pixel keeps what orders its samples better. Needs 6 lights.

    Parameters
    ----------
    degree_intensity, degree_light : degrees N1 and N2 of g in I and in v.l
    bend : cost of squared differences between neighbouring d, relative to the mean square of Phi
    spread : residual n.l - g that halves a sample's weight
    window : which samples enter
    start : gives the normal that the first weights rest on
    rounds : of reweighting
    degree_half, bend_half, spread_half : the same for n.h = g(sqrt I)
    """

    degree_intensity: Degree = 2
    degree_light: Degree = 1
    bend: NotNegative = 3e-3
    spread: Positive = 0.03
    window: Trimmed = field(default=Trimmed(lowest=0.0, highest=0.75, least=12))
    start: Trimmed = field(default=Trimmed())
    rounds: Whole = 5
    degree_half: Degree = 4
    bend_half: NotNegative = 1e-4
    spread_half: Positive = 0.015

    needs: ClassVar[Needs] = Needs(images=6, double=True)

    def __call__(self, seen: Observations) -> Solution:
        fit = self.fit_metal if seen.metallic() else self.fit
        return Solution(fit(seen.I, seen.keep, seen.lights))

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        start = self.start.fit(I, keep, L)
        keep = keep & self.window.window(I, keep)
        low, high = L[..., 2].amin(-1, keepdim=True), L[..., 2].amax(-1, keepdim=True)
        x = (L[..., 2] - low) / (high - low).clamp(min=1e-12)  # v.l from 0 to 1, (*l, n)
        B = bernstein(x, self.degree_light)
        Phi = torch.stack([g * b for g in growing(relative(I, keep), self.degree_intensity) for b in B], dim=-1)
        bend = bending(self.bend, self.degree_intensity, len(B)).to(Phi)
        w = keep.to(I.dtype) / (1 + (lambertian_residual(I, keep, cosines(start, L)) / 0.2) ** 2)
        return self.regression(Phi, torch.ones_like(bend[0]), bend, L, keep, w, self.spread, start)

    def fit_metal(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """As `fit`, or the fit of n.h = g(sqrt I), g(0) >= 0, where that orders the samples better."""
        n, H = self.fit(I, keep, L), half_vectors(L)
        rising = growing(relative(I, keep).sqrt(), self.degree_half)
        Phi = torch.stack([torch.ones_like(I), *rising], dim=-1)
        bend = torch.block_diag(torch.full((1, 1), TINY), bending(self.bend_half, self.degree_half, 1)).to(Phi)
        rises = torch.ones_like(bend[0]).index_fill(0, torch.tensor([0], device=I.device), 0)
        w = keep.to(I.dtype)
        shiny = self.regression(Phi, rises, bend, H, keep, w, self.spread_half, n)
        return torch.where(disorder(I, keep, cosines(shiny, H)) < disorder(I, keep, cosines(n, L)), shiny, n)

    def regression(
        self,
        Phi: Float[Tensor, "p n m"],
        rises: Float[Tensor, " m"],
        bend: Float[Tensor, "m m"],
        A: Float[Tensor, "*l n 3"],
        keep: Bool[Tensor, "p n"],
        w: Float[Tensor, "p n"],
        spread: float,
        n: Float[Tensor, "p 3"],
    ) -> Float[Tensor, "p 3"]:
        """Unit n that minimise |A n - Phi d|^2 over d >= 0, rises.d fixed, samples reweighted from `w` on; else `n`."""
        for _ in range(self.rounds):
            inverse, fixed = symmetric_inverse(over_lights(w, pairs(A)))  # of A'wA
            inverse = inverse[:, SIX_TO_NINE].unflatten(1, (3, 3))
            wPhi = w[..., None] * Phi
            APhi = A.transpose(-1, -2) @ wPhi  # (p, 3, m)
            G = wPhi.transpose(1, 2) @ Phi - APhi.transpose(1, 2) @ inverse @ APhi  # of |A n - Phi d|^2 with the best n
            G = G / (wPhi * Phi).sum((1, 2)).div(Phi.shape[2]).clamp(min=1e-12)[:, None, None] + bend
            d = nonnegative_minimum(G, rises.expand(G.shape[:2]))  # (p, m), up to scale
            b = (inverse @ APhi @ d[..., None])[..., 0]
            r = (cosines(b, A) - (Phi @ d[..., None])[..., 0]) / b.norm(dim=-1, keepdim=True).clamp(min=1e-12)
            w = keep / (1 + (r / spread) ** 2)
            n = torch.where(fixed, normalised(b), n)
        return n


def relative(I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"]) -> Float[Tensor, "p n"]:
    """I over the pixel's brightest sample to `keep`."""
    return (I / (I * keep).amax(1, keepdim=True).clamp(min=1e-12)).clamp(max=1)


def growing(y: Float[Tensor, "*p"], degree: int) -> list[Float[Tensor, "*p"]]:
    """sum_{i>=k} B_i(y) for k from 1 to the degree: they grow from 0 to 1."""
    B = bernstein(y, degree)
    return [torch.stack(B[k:]).sum(0) for k in range(1, len(B))]


def bending(cost: float, k: int, j: int) -> Float[Tensor, "m m"]:
    """The quadratic form of the cost of differences between neighbours of a k x j table; TINY keeps it definite."""
    index = torch.arange(k * j).reshape(k, j)
    unit = torch.eye(k * j)
    D = torch.cat([unit[index[1:].flatten()] - unit[index[:-1].flatten()],
                   unit[index[:, 1:].flatten()] - unit[index[:, :-1].flatten()]])  # fmt: skip
    return cost * D.T @ D + TINY * unit


def disorder(I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], cos: Float[Tensor, "p n"]) -> Float[Tensor, "p 1"]:
    """How far the ranks of the samples to `keep` by I are from those by the cosine, in sum."""
    by_I, by_cos = (ascending_order(ascending_order(torch.where(keep, x, torch.inf))) for x in (I, cos))
    return ((by_I - by_cos).abs() * keep).sum(1, keepdim=True).to(I.dtype)


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
