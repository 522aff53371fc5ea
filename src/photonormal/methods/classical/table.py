"""Reflectance as a table: N. Alldrin, T. Zickler, D. Kriegman, CVPR 2008."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import pi
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.alternation import Alternation
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.options import Effort
from photonormal.shading import cosines, half_vectors, shade


@dataclass(frozen=True)
class DiscreteTable:
    """I = a_p B(theta_h, theta_d) n.l with one table B for the object and an albedo a_p and a normal for each pixel.

    B is read off the samples of some pixels, then all normals are refined under it, in turn. Objects of several very
    different materials fit one table badly. Needs 10 lights.

    Parameters
    ----------
    half, difference : cells of the table over theta_h (finer near 0) and over the theta_d that the lights reach
    smooth : width in cells of the smoothing, over theta_h and theta_d
    alternation : of reading off, then refining
    """

    half: Effort = 40
    difference: Effort = 4
    smooth: tuple[float, float] = (0.7, 0.8)
    alternation: Alternation = field(default=Alternation(sample=6000, rounds=4))

    needs: ClassVar[Needs] = Needs(images=10, reads="object")

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.alternation(self.flat, seen))

    def flat(self, L: Float[Tensor, "*l n 3"]) -> Tabulated:
        """The table of a matt object."""
        B = torch.ones(self.half + 1, self.difference, device=L.device)
        return Tabulated(B, AngleGrid.under(L, self.half, self.difference), self.smooth)


@dataclass(frozen=True)
class Tabulated:
    """The reflectance B(theta_h, theta_d)."""

    B: Float[Tensor, "k m"]
    grid: AngleGrid
    smooth: tuple[float, float]

    def model(
        self, some: slice, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], n: Float[Tensor, "p 3"]
    ) -> Callable[[Tensor], Tensor]:
        """B n.l as a function of the normals."""
        grid = self.grid.seen_from(some)
        return lambda n: shade(grid.look_up(self.B, n), cosines(n, grid.L).clamp(min=1e-4))

    def fitted(
        self, some: Tensor, I: Float[Tensor, "q n"], keep: Bool[Tensor, "q n"], n: Float[Tensor, "q 3"]
    ) -> Tabulated:
        """The smooth table that explains the samples I best, given normals; albedos are found in turn, three times."""
        B, grid = self.B, self.grid.seen_from(some)
        cos = cosines(n, grid.L)
        w = keep * (cos > 0.05)
        weight = grid.sums(n, w * cos**2)
        for _ in range(3):
            f = shade(grid.look_up(B, n), cos)
            a = (w * f * I).sum(1, keepdim=True) / (w * f * f).sum(1, keepdim=True).clamp(min=1e-12)  # (q, 1)
            total = grid.sums(n, w * cos * I / a.clamp(min=1e-6))  # of B cos^2
            B = smoothed(total, self.smooth) / smoothed(weight, self.smooth).clamp(min=1e-9)
            B = filled(B, weight > 1e-5 * weight.max())
            B = (B / B.median()).clamp(min=1e-3)
        return replace(self, B=B)


@dataclass(frozen=True)
class AngleGrid:
    """Where the samples of given lights fall in a table over (theta_h, theta_d); theta_d depends on the light alone."""

    L: Float[Tensor, "*l n 3"]
    H: Float[Tensor, "*l n 3"]
    half: int  # cells over theta_h
    column: Float[Tensor, "*l n"]  # with fraction

    @classmethod
    def under(cls, L: Float[Tensor, "*l n 3"], half: int, difference: int) -> AngleGrid:
        """The grid of lights L."""
        H = half_vectors(L)
        theta_d = (L * H).sum(-1).clamp(-1, 1).acos()
        span = (theta_d.max() - theta_d.min()).clamp(min=1e-6)
        return cls(L, H, half, (theta_d - theta_d.min()) / span * (difference - 1))

    def seen_from(self, some: slice | Tensor) -> AngleGrid:
        """The grid of some pixels."""
        if self.L.ndim == 2:
            return self
        return replace(self, L=self.L[some], H=self.H[some], column=self.column[some])

    def rows(self, n: Float[Tensor, "p 3"]) -> Float[Tensor, "p n"]:
        """Row of each sample, with fraction: as the root of theta_h."""
        theta_h = cosines(n, self.H).clamp(-1, 1).acos()
        return (theta_h / (pi / 2)).clamp(max=1).sqrt() * self.half

    def look_up(self, B: Float[Tensor, "k m"], n: Float[Tensor, "p 3"]) -> Float[Tensor, "p n"]:
        """The table's value for each sample, bilinear."""
        j = self.column.floor().clamp(max=B.shape[1] - 2).long()
        row = self.rows(n)
        i = row.floor().clamp(max=self.half - 1).long()
        low, high = (torch.lerp(B[k, j], B[k, j + 1], self.column - j) for k in (i, i + 1))
        return torch.lerp(low, high, row - i)

    def sums(self, n: Float[Tensor, "p 3"], values: Float[Tensor, "p n"]) -> Float[Tensor, "k m"]:
        """Sums of the samples' values in the nearest cells."""
        columns = round(float(self.column.max())) + 1
        cell = self.rows(n).round().long() * columns + self.column.round().long()
        sums = values.new_zeros((self.half + 1) * columns)
        return sums.index_add_(0, cell.flatten(), values.flatten()).reshape(-1, columns)


def smoothed(B: Float[Tensor, "k m"], width: tuple[float, float]) -> Float[Tensor, "k m"]:
    """Gaussian smoothing; the border repeats."""
    for axis in (0, 1):
        offset = torch.arange(-3, 4, device=B.device)
        kernel = torch.exp(-0.5 * (offset / width[axis]) ** 2).to(B.dtype)
        index = torch.arange(B.shape[axis], device=B.device)[:, None] + offset
        parts = B.movedim(axis, 0)[index.clamp(0, B.shape[axis] - 1)]  # (k, 7, m)
        B = torch.einsum("kwm,w->km", parts, kernel / kernel.sum()).movedim(0, axis)
    return B


def filled(B: Float[Tensor, "k m"], seen: Bool[Tensor, "k m"]) -> Float[Tensor, "k m"]:
    """Unseen cells take the value of the nearest seen one of larger theta_h, or else of smaller."""
    for order in (range(B.shape[0] - 2, -1, -1), range(1, B.shape[0])):
        step = order.step
        for k in order:
            take = ~seen[k] & seen[k - step]
            B = B.index_copy(0, torch.tensor([k], device=B.device), torch.where(take, B[k - step], B[k])[None])
            seen = seen.index_copy(0, torch.tensor([k], device=B.device), (seen[k] | take)[None])
    return B
