"""Elevation from reflectance monotonicity: B. Shi, P. Tan, Y. Matsushita, K. Ikeuchi, ECCV 2012."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.bivariate import Bivariate
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.inputs.grey import ascending_order
from photonormal.options import Angle, NotNegative, Share
from photonormal.shading import cosines, half_vectors, normalised


@dataclass(frozen=True)
class Monotonic:
    """The elevation angle at which rho = I / n.l grows most steadily with n.h, along a known azimuth.

    A BRDF of one lobe falls off as the half vector leaves the normal, and only the right elevation orders all samples
    so. Strong on metal, where highlights show the elevation; weak on matt surfaces under a narrow cone of lights, where
    many elevations do. There the flattest rho wins. Needs 6 lights.

    Parameters
    ----------
    azimuth : gives the normal whose azimuth is kept
    rise : cost of a rise of rho, relative to that of a fall
    limit : change of rho between neighbours, over its mean, above which costs grow no more
    least_cosine : n.l below which rho is not trusted
    grid_deg : step of the first search over the elevation, halved three times around the best
    """

    azimuth: Bivariate = field(default=Bivariate())
    rise: NotNegative = 0.3
    limit: NotNegative = 0.2
    least_cosine: Share = 0.1
    grid_deg: Angle = 3.0

    needs: ClassVar[Needs] = Needs(images=6)

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.fit(seen.I, seen.keep, seen.lights))

    def fit(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "p 3"]:
        """Unit normals from the samples to `keep`."""
        known = self.azimuth.fit(I.double(), keep, L.double()).to(I.dtype)
        across = known * known.new_tensor([1, 1, 0])
        across = normalised(torch.where(across.norm(dim=-1, keepdim=True) > 1e-6, across, across.new_tensor([1, 0, 0])))
        up = known.new_tensor([0, 0, 1])
        H = half_vectors(L)

        def normal(theta: Tensor) -> Tensor:  # (p, 1) -> (p, 3)
            return theta.sin() * across + theta.cos() * up

        theta = torch.zeros_like(I[:, :1])
        least = torch.full_like(theta, torch.inf)
        step = radians(self.grid_deg)
        trials = [torch.full_like(theta, k * step) for k in range(round(radians(90) / step))]
        for _ in range(4):
            for trial in trials:
                cost = self.disorder(I, keep, cosines(normal(trial), L), cosines(normal(trial), H))
                theta = torch.where(cost < least, trial, theta)
                least = torch.minimum(cost, least)
            step /= 2
            trials = [(theta + step).clamp(max=radians(89)), (theta - step).clamp(min=0)]
        found = keep.any(1, keepdim=True) & (known.norm(dim=-1, keepdim=True) > 0)
        return normal(theta) * found

    def disorder(
        self, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], cos: Float[Tensor, "p n"], x: Float[Tensor, "p n"]
    ) -> Float[Tensor, "p 1"]:
        """Cost of the falls (and, less, the rises) of I / cos in the order of growing x = n.h, and of samples lost."""
        use = keep & (cos > self.least_cosine)
        rho = I / cos.clamp(min=self.least_cosine)
        mean = (rho * use).sum(1, keepdim=True) / use.sum(1, keepdim=True).clamp(min=1)
        order = ascending_order(torch.where(use, x, -2))  # unused ones first
        rho, c, used = rho.gather(1, order), cos.gather(1, order), use.gather(1, order)[:, :-1]
        change = (rho[:, 1:] - rho[:, :-1]) / mean.clamp(min=1e-9) * torch.minimum(c[:, 1:], c[:, :-1]) * used
        change = change.clamp(-self.limit, self.limit)
        cost = change.clamp(max=0).abs() + self.rise * change.clamp(min=0)
        lit = keep.sum(1, keepdim=True)
        lost = lit - use.sum(1, keepdim=True)
        return cost.sum(1, keepdim=True) + 0.5 * lost + 1e3 * (2 * lost > lit)
