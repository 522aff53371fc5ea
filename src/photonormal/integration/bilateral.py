"""Depth that may jump: X. Cao, H. Santo, B. Shi, F. Okura, Y. Matsushita, "Bilateral normal integration", ECCV 2022.

Written from the paper's equations; the last rounds are our own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from photonormal.integration.conjugate import conjugate_gradients
from photonormal.integration.multigrid import BLOCK, TINY, Multigrid
from photonormal.integration.slopes import Slopes, pairs, surface, weighted_laplacian
from photonormal.types import InputError, Normals, Surface

ENDS = (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])  # first and second pixels of the edges along x, along y
CLEAR = 14.0  # no side is trusted by less than e^-14, so that parts of the surface stay in touch
HELD = np.float32(1e-6)  # weight by which every edge keeps its step where combined equations tell next to nothing

Along = Float[np.ndarray, "_ _"]


@dataclass(frozen=True)
class Bilateral:
    """Every pixel trusts the smoother of its two sides, along rows and along columns.

    At pixel i the surface is differentiable from one side at least: a D+ z = b towards the next pixel has weight
    w = sigmoid(k ((a D- z)^2 - (a D+ z)^2)), a D- z = b towards the last one has 1 - w (a missing neighbour counts as
    no step). Weighted least squares and weights alternate, from w = 1/2. At a jump both pixels look away from it.

    These equations find the jumps, but are of first order where the surface bends, and take a normal at grazing view,
    which tells little of its slope, nearly as seriously as any other. In the last rounds (`combined`) an edge has one
    equation: its slope is the mean of both ends where both trust it, its weight is by what errors of normals do to it,
    and edges that the surface contradicts lose theirs (Cauchy's weights).

    Parameters
    ----------
    k : sharpness of the choice between the two sides; 0 is plain weighted least squares, 2 the paper's value
    grazing : least cosine between a normal and its viewing ray, (0, 1)
    tolerance : relative change of the energy at which the alternation stops
    rounds : most alternations
    combined : rounds of the combined equations; 0 gives the paper's method
    outlier_deg : error of a normal, above 0, from which on an edge counts as contradicted
    """

    k: float = 2.0
    grazing: float = 0.01
    tolerance: float = 1e-4
    rounds: int = 150
    combined: int = 2
    outlier_deg: float = 1.0

    def __post_init__(self) -> None:
        if not (self.k >= 0 and self.rounds >= 1):
            raise InputError(f"k is {self.k} and rounds {self.rounds}; k >= 0 and at least one round are needed.")
        if not (self.combined >= 0 and self.outlier_deg > 0):
            raise InputError(
                f"combined is {self.combined} and outlier_deg {self.outlier_deg}; no fewer than 0 rounds and an angle "
                "above 0 are needed."
            )

    def __call__(self, normals: Normals, K: np.ndarray | None = None) -> Surface:
        slopes = Slopes(normals, K, self.grazing)
        equations = Equations(slopes, self.k)
        z, energy = np.zeros(slopes.mask.shape), np.inf
        for _ in range(self.rounds):
            before, (system, energy) = energy, equations.one_sided(z)
            if abs(before - energy) <= self.tolerance * energy:
                break
            z = system.solved(z, tolerance=1e-3, most=30)
        chosen = z.astype(np.float32)
        for turn in range(self.combined):
            outlier = np.radians(self.outlier_deg) if turn else np.inf
            last = turn == self.combined - 1
            system = equations.combined(z, chosen, outlier)
            z = system.solved(z, tolerance=1e-5 if last else 1e-3, most=100)
        return surface(z, slopes)


class System(NamedTuple):
    """-div(c grad z) = rhs, with weights of the edges to the right and of those down."""

    cx: Float[np.ndarray, "h w1"]
    cy: Float[np.ndarray, "h1 w"]
    rhs: Float[np.ndarray, "h w"]

    def solved(self, z: Float[np.ndarray, "h w"], tolerance: float, most: int) -> Float[np.ndarray, "h w"]:
        """By at most so many iterations from `z`, which is written over."""
        z, _ = conjugate_gradients(
            lambda z: weighted_laplacian(z, self.cx, self.cy),
            self.rhs,
            z,
            Multigrid(self.cx, self.cy),
            tolerance,
            most,
            np.float32,
        )
        return z


class Edges(NamedTuple):
    """Edges along one axis of some rows, from pixels i to the next ones j: steps of z, and what either end says."""

    axis: int
    rows: slice
    dz: Along
    wi: Along  # weight of i's equation a_i dz = b_i
    wj: Along  # and of j's, a_j dz = b_j
    ai: Along
    aj: Along
    bi: Along
    bj: Along


class Equations:
    """What normals say of the steps from every pixel towards its neighbours."""

    def __init__(self, slopes: Slopes, k: float) -> None:
        self.known = pairs(slopes.mask)
        self.k = np.float32(k)
        h, w = slopes.mask.shape
        self.rows = max(32, BLOCK // w)  # three more are looked at each time
        self.a, self.b = np.empty((h, w), np.float32), np.empty((2, h, w), np.float32)
        for y in range(0, h, self.rows):
            rows = slice(y, min(y + self.rows, h))
            self.a[rows], self.b[:, rows] = slopes.rows(rows.start, rows.stop)
        self.a[~slopes.mask] = 1  # of no edge, but divided by

    def edges(self, z: Float[np.ndarray, "h w"]) -> Iterator[Edges]:
        """All edges, some rows after the other, with weights by the steps of `z`."""
        for y in range(0, len(z), self.rows):
            part = slice(max(y - 1, 0), y + self.rows + 2)  # weights need the steps before and behind
            for axis, (i, j) in enumerate(ENDS):
                a, known = self.a[part], self.known[axis][part]
                known = known[: len(a) - axis]
                dz = np.diff(z[part], axis=1 - axis).astype(np.float32)
                dz *= known
                gain = np.zeros_like(a)
                gain[j] += (a[j] * dz) ** 2
                gain[i] -= (a[i] * dz) ** 2
                gain *= self.k
                w = expit(np.clip(gain, -CLEAR, CLEAR, out=gain), out=gain)
                own = slice(y - part.start, y - part.start + self.rows)
                b = self.b[axis, part]
                values = dz, w[i] * known, (1 - w[j]) * known, a[i], a[j], b[i], b[j]
                yield Edges(axis, slice(y, y + self.rows), *(v[own] for v in values))

    def one_sided(self, z: Float[np.ndarray, "h w"]) -> tuple[System, float]:
        """The least squares of all equations with weights by `z`, and their energy there."""
        system, energy = self.empty(), 0.0
        for e in self.edges(z):
            wi, wj = e.wi * e.ai, e.wj * e.aj
            add(system, e, wi * e.ai + wj * e.aj, wi * e.bi + wj * e.bj)
            energy += float((e.wi * (e.ai * e.dz - e.bi) ** 2 + e.wj * (e.aj * e.dz - e.bj) ** 2).sum(dtype=np.float64))
        return system, energy

    def combined(
        self, z: Float[np.ndarray, "h w"], chosen: Float[np.ndarray, "h w"], outlier: float | np.floating
    ) -> System:
        """One equation an edge, dz = p b_i / a_i + (1 - p) b_j / a_j, where `chosen` gives the weights of its ends.

        p is the share of i in these weights, drawn to a half where they are alike. An error d of a normal moves b / a
        by d / a^2, which gives the equation's precision; a grazing end beside one that is not is about a rim, and
        lowers it. Equations that `z` contradicts by more than an error `outlier` (radians) lose weight. Where all have
        next to none, as across a jump, the step is that of `chosen`.
        """
        system = self.empty()
        for e in self.edges(chosen):
            weight = e.wi + e.wj
            x = e.wi / np.maximum(weight, TINY)
            p = x + 4 * x * (1 - x) * (np.float32(0.5) - x)
            slope = p * e.bi / e.ai + (1 - p) * e.bj / e.aj
            si, sj = e.ai**2, e.aj**2
            precision = np.minimum(si, sj) / (np.maximum(si, sj) * np.hypot(p / si, (1 - p) / sj))
            dz = np.diff(z[e.rows.start : e.rows.stop + e.axis], axis=1 - e.axis).astype(np.float32)
            c = weight * precision**2 / (1 + ((dz - slope) * precision / np.float32(outlier)) ** 2)
            held = HELD * (weight > 0)
            add(system, e, c + held, c * slope + held * e.dz)
        return system

    def empty(self) -> System:
        """To be filled by `add`."""
        h, w = self.a.shape
        return System(np.empty((h, w - 1), np.float32), np.empty((h - 1, w), np.float32), np.zeros((h, w)))


def add(system: System, e: Edges, c: Along, flow: Along) -> None:
    """Add c dz^2 - 2 flow dz of some edges to the least squares."""
    (system.cx, system.cy)[e.axis][e.rows] = c
    rhs = system.rhs[e.rows.start : e.rows.stop + e.axis]
    i, j = ENDS[e.axis]
    rhs[i] -= flow
    rhs[j] += flow
