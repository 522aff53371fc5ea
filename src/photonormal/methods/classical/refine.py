"""Normals that fit a given reflectance best: two angles and an albedo at each pixel, by damped Gauss-Newton steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.woodham import symmetric_inverse, symmetric_product
from photonormal.shading import normalised

TURN = 2e-3  # radians by which normals are turned to see how a prediction changes


@dataclass(frozen=True)
class Refinement:
    """minimise over n, t: sum_j log(1 + r_j^2 / spread^2), r = sqrt(I) - t sqrt(model(n)), over lit samples.

    Roots, in units of the pixel's mean root, tame highlights; the logarithm tames cast shadows.

    Parameters
    ----------
    spread : residual beyond which a sample loses weight
    steps : of Gauss-Newton
    longest : step, radians
    """

    spread: float = 0.1
    steps: int = 4
    longest: float = 0.1

    def __call__(
        self,
        model: Callable[[Tensor], Tensor],
        I: Float[Tensor, "p n"],
        keep: Bool[Tensor, "p n"],
        n: Float[Tensor, "p 3"],
    ) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 1"]]:
        """Unit normals and their loss. `model` maps normals (p, 3) to radiance at albedo 1 (p, n)."""
        w = keep.to(I.dtype)
        root = I.clamp(min=0).sqrt()
        root = root / ((root * w).sum(1, keepdim=True) / w.sum(1, keepdim=True).clamp(min=1)).clamp(min=1e-9)
        trial = n
        least = torch.full_like(w[:, :1], torch.inf)
        damping = torch.full_like(least, 1e-2)
        state: list[Tensor] = []  # normal equations and tangents at the best normals so far
        for step in range(self.steps + 1):
            f = model(trial).clamp(min=0).sqrt()
            t, v, r = self.albedo(root, f, w)
            loss = (w * torch.log1p((r / self.spread) ** 2)).sum(1, keepdim=True)
            better = loss < least
            n, least = torch.where(better, trial, n), torch.where(better, loss, least)
            damping = torch.where(better, damping / 3, damping * 5)
            if step == self.steps:
                break
            a, b = tangents(trial)
            J = [t * (model(normalised(trial + TURN * e)).clamp(min=0).sqrt() - f) / TURN for e in (a, b)] + [f]
            A = torch.stack([(v * J[i] * J[j]).sum(1) for i in range(3) for j in range(i, 3)], dim=1)  # (p, 6)
            y = torch.stack([(v * g * r).sum(1) for g in J], dim=1)  # (p, 3)
            here = [A, y, a, b]
            state = [torch.where(better, x, old) for x, old in zip(here, state or here, strict=True)]
            A, y, a, b = state
            inverse, _ = symmetric_inverse(A + (damping * A + 1e-9) * A.new_tensor([1, 0, 0, 1, 0, 0]))
            turn = symmetric_product(inverse, y)[:, :2].nan_to_num(0)
            turn = turn * (self.longest / turn.norm(dim=1, keepdim=True).clamp(min=1e-9)).clamp(max=1)
            trial = normalised(n + turn[:, :1] * a + turn[:, 1:] * b)
        return n, least

    def albedo(
        self, root: Float[Tensor, "p n"], f: Float[Tensor, "p n"], w: Float[Tensor, "p n"]
    ) -> tuple[Float[Tensor, "p 1"], Float[Tensor, "p n"], Float[Tensor, "p n"]]:
        """The factor t of f, the weights of the samples and what remains, reweighted once."""
        v = w
        for _ in range(2):
            t = (v * f * root).sum(1, keepdim=True) / (v * f * f).sum(1, keepdim=True).clamp(min=1e-12)
            r = root - t * f
            v = w / (1 + (r / self.spread) ** 2)
        return t, v, r  # pyright: ignore[reportPossiblyUnboundVariable]


def tangents(n: Float[Tensor, "p 3"]) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"]]:
    """Two unit vectors at right angles to each normal and to each other."""
    up = torch.where(n[:, 1:2].abs() < 0.9, n.new_tensor([0, 1, 0]), n.new_tensor([1, 0, 0]))
    a = normalised(torch.linalg.cross(up, n))
    return a, torch.linalg.cross(n, a)
