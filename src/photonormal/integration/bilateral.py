"""Depth that may jump: X. Cao, H. Santo, B. Shi, F. Okura, Y. Matsushita, "Bilateral normal integration", ECCV 2022.

Written from the paper's equations; the start and the last rounds are our own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from photonormal.integration.bands import each_band
from photonormal.integration.conjugate import conjugate_gradients
from photonormal.integration.grid import TINY, padded
from photonormal.integration.multigrid import Multigrid
from photonormal.integration.slopes import Slopes, surface, weighted_laplacian
from photonormal.types import InputError, Normals, Surface

ENDS = (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])  # first and second pixels of the edges along x, along y
CLEAR = 14.0  # no side is trusted by less than e^-14, so that parts of the surface stay in touch
STILL = 1e-3  # pixels by which the surface changes in a round that is the last
CURL_DEG = 0.3  # error of normals, from whose curl on slopes count as no surface's
DOUBTED = np.float32(1e-4)  # trust in edges of no surface
HELD = np.float32(1e-6)  # weight by which every edge keeps its step where combined equations show next to nothing

Along = Float[np.ndarray, "_ _"]


@dataclass(frozen=True)
class Bilateral:
    """Every pixel trusts the smoother of its two sides, along rows and along columns.

    At pixel i the surface is differentiable from one side at least: a D+ z = b towards the next pixel has weight
    w = sigmoid(k ((a D- z)^2 - (a D+ z)^2)), a D- z = b towards the last one has 1 - w (a missing neighbour counts as
    no step). Weighted least squares and weights alternate. At a jump both pixels look away from it. They begin with
    w = 1/2 times the trust in each edge: slopes around four pixels of a surface add up to nothing, and next to a jump
    whose height changes they don't. Without that a jump pulls at what leads around it until it breaks there, as at a
    bowl's narrow rim.

    These equations find the jumps, but are of first order where the surface bends, and take a normal at grazing view,
    which shows little of its slope, nearly as seriously as any other. In the last rounds (`combined`) an edge has one
    equation: its slope is the mean of both ends where both trust it, its weight is by what errors of normals do to it,
    and edges that the surface contradicts lose theirs (Cauchy's weights).

    Parameters
    ----------
    k : sharpness of the choice between the two sides; 0 is plain weighted least squares, 2 the paper's value
    grazing : least cosine between a normal and its viewing ray, (0, 1)
    tolerance : relative change of the energy at which the alternation stops, if the surface has not come to rest before
    rounds : most alternations
    combined : rounds of the combined equations; with 0 only the start is not the paper's
    outlier_deg : error of a normal, above 0, from which on an edge counts as contradicted
    """

    k: float = 2.0
    grazing: float = 0.01
    tolerance: float = 3e-5
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
        z, energy = equations.begun().solved(np.zeros(equations.shape), tolerance=1e-3, most=30), np.inf
        for _ in range(self.rounds):
            before, (system, energy) = energy, equations.one_sided(z)
            if abs(before - energy) <= self.tolerance * energy:
                break
            chosen = z.astype(np.float32)
            z = system.solved(z, tolerance=1e-3, most=30)
            if equations.moved(chosen, z) < STILL:
                break
        chosen = z.astype(np.float32)
        for turn in range(self.combined):
            outlier = np.radians(self.outlier_deg) if turn else np.inf
            last = turn == self.combined - 1
            system = equations.combined(z, chosen, outlier)
            z = system.solved(z, tolerance=1e-5 if last else 1e-3, most=100)
        h, w = slopes.mask.shape
        return surface(z[:h, :w], slopes)


class System(NamedTuple):
    """-div(c grad z) = rhs, with weights of the edges to the right and of those down."""

    cx: Float[np.ndarray, "h w1"]
    cy: Float[np.ndarray, "h1 w"]
    rhs: Float[np.ndarray, "h w"]

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> System:
        """To be filled by `add`."""
        h, w = shape
        return cls(np.empty((h, w - 1), np.float32), np.empty((h - 1, w), np.float32), np.zeros((h, w)))

    def add(self, e: Edges, c: Along, flow: Along) -> None:
        """Fill some rows with c dz^2 - 2 flow dz of the edges that end in them."""
        before = int(e.rows.start > 0)  # rows of edges that begin above
        (self.cx, self.cy)[e.axis][e.rows] = c[before:]
        rhs = self.rhs[e.rows]
        if e.axis == 0:
            rhs[:, :-1] -= flow[before:]
            rhs[:, 1:] += flow[before:]
        else:
            rhs[: len(flow) - before] -= flow[before:]
            rhs[1 - before :] += flow[: len(rhs) + before - 1]

    def solved(self, z: Float[np.ndarray, "h w"], tolerance: float, most: int) -> Float[np.ndarray, "h w"]:
        """By at most so many iterations from `z`, which is written over."""
        z, _ = conjugate_gradients(
            lambda z, rows: weighted_laplacian(z, self.cx, self.cy, rows),
            self.rhs,
            z,
            Multigrid(self.cx, self.cy),
            tolerance,
            most,
            np.float32,
        )
        return z


class Edges(NamedTuple):
    """Edges along one axis that end in some rows, from pixels i to the next ones j: steps of z, what the ends say."""

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
    """What normals say of the steps from every pixel towards its neighbours; odd numbers of rows and columns."""

    def __init__(self, slopes: Slopes, k: float) -> None:
        h, w = slopes.mask.shape
        self.shape = h | 1, w | 1
        self.mask = padded(slopes.mask, *self.shape, bool)
        self.k = np.float32(k)
        self.a, self.b = np.ones(self.shape, np.float32), np.zeros((2, *self.shape), np.float32)

        def fill(rows: slice) -> None:
            a, self.b[:, rows, :w] = slopes.rows(rows.start, rows.stop)
            # elsewhere of no edge, but divided by
            np.copyto(self.a[rows, :w], a, where=slopes.mask[rows], casting="same_kind")

        each_band(fill, h, w)

    def edges(self, z: Float[np.ndarray, "h w"], rows: slice) -> Iterator[Edges]:
        """The edges that begin in some rows or in the row before, with weights by the steps of `z`."""
        begin = slice(max(rows.start - 1, 0), rows.stop)
        part = slice(max(rows.start - 2, 0), rows.stop + 2)  # weights need the steps before and behind
        own = slice(begin.start - part.start, begin.stop - part.start)
        mask, a = self.mask[part], self.a[part]
        for axis, (i, j) in enumerate(ENDS):
            known = mask[i] & mask[j]
            dz = np.diff(z[part], axis=1 - axis).astype(np.float32)
            dz *= known
            gain = np.zeros_like(a)
            gain[j] += (a[j] * dz) ** 2
            gain[i] -= (a[i] * dz) ** 2
            gain *= self.k
            w = expit(np.clip(gain, -CLEAR, CLEAR, out=gain), out=gain)
            b = self.b[axis, part]
            values = dz, w[i] * known, (1 - w[j]) * known, a[i], a[j], b[i], b[j]
            yield Edges(axis, rows, *(v[own] for v in values))

    def curl(self) -> Float[np.ndarray, "h1 w1"]:
        """Squared, of the slopes around four pixels, over what errors of CURL_DEG make of it; infinite off the mask.

        A slope is (b_i + b_j) / (a_i + a_j), exact on planes and spheres. In [y, x] is the one above and to the left of
        pixel y, x.
        """
        h, w = self.shape
        found = np.full((h + 1, w + 1), np.inf, np.float32)

        def fill(rows: slice) -> None:
            part = slice(rows.start, rows.stop + 1)
            mask, a = self.mask[part], self.a[part]
            curl, variance = (np.zeros((len(a) - 1, w - 1), np.float32) for _ in range(2))
            for axis, (i, j) in enumerate(ENDS):
                first, second = ENDS[1 - axis]  # of two edges side by side
                length = a[i] + a[j]
                slope = (self.b[axis, part][i] + self.b[axis, part][j]) / length
                own = 2 * (1 + slope**2) / length**2
                curl += (-1) ** axis * (slope[second] - slope[first])
                variance += own[first] + own[second]
            off = curl**2 / (np.radians(CURL_DEG) ** 2 * variance)
            inside = mask[:-1, :-1] & mask[:-1, 1:] & mask[1:, :-1] & mask[1:, 1:]
            np.copyto(found[1:-1, 1:-1][rows], off, where=inside, casting="same_kind")

        each_band(fill, h - 1, w - 1)
        return found

    def begun(self) -> System:
        """The least squares of all equations, whose two sides count alike, by the trust in each edge.

        That goes by the less of the two curls beside it: an edge that runs along a jump has another one.
        """
        system, curl, flat = System.empty(self.shape), self.curl(), np.zeros(self.shape, np.float32)

        def fill(rows: slice) -> None:
            begin = max(rows.start - 1, 0)
            here = curl[begin : rows.stop + 1]
            beside = np.minimum(here[:-1, 1:-1], here[1:, 1:-1]), np.minimum(here[1:, :-1], here[1:, 1:])
            for e in self.edges(flat, rows):
                trust = 1 / (1 + beside[e.axis][: len(e.dz)]) + DOUBTED
                wi, wj = trust * e.wi * e.ai, trust * e.wj * e.aj
                system.add(e, wi * e.ai + wj * e.aj, wi * e.bi + wj * e.bj)

        each_band(fill, *self.shape)
        return system

    def moved(self, before: Float[np.ndarray, "h w"], z: Float[np.ndarray, "h w"]) -> float:
        """How far on average, but for what all pixels moved together: of that normals show nothing."""
        number = np.count_nonzero(self.mask)

        def summed(value: Callable[[np.ndarray], np.ndarray]) -> float:
            each = each_band(lambda rows: value(z[rows] - before[rows]).sum(where=self.mask[rows]), *self.shape)
            return float(sum(each)) / number

        together = summed(lambda step: step)
        return summed(lambda step: np.abs(step - together))

    def one_sided(self, z: Float[np.ndarray, "h w"]) -> tuple[System, float]:
        """The least squares of all equations with weights by `z`, and their energy there."""
        system = System.empty(self.shape)

        def fill(rows: slice) -> float:
            energy = 0.0
            for e in self.edges(z, rows):
                wi, wj = e.wi * e.ai, e.wj * e.aj
                system.add(e, wi * e.ai + wj * e.aj, wi * e.bi + wj * e.bj)
                each = e.wi * (e.ai * e.dz - e.bi) ** 2 + e.wj * (e.aj * e.dz - e.bj) ** 2
                energy += float(each[rows.start > 0 :].sum(dtype=np.float64))
            return energy

        return system, sum(each_band(fill, *self.shape))

    def combined(
        self, z: Float[np.ndarray, "h w"], chosen: Float[np.ndarray, "h w"], outlier: float | np.floating
    ) -> System:
        """One equation an edge, dz = p b_i / a_i + (1 - p) b_j / a_j, where `chosen` gives the weights of its ends.

        p is the share of i in these weights, drawn to a half where they are alike. An error d of a normal moves b / a
        by d / a^2, which gives the equation's precision; a grazing end beside one that is not is about a rim, and
        lowers it. Equations that `z` contradicts by more than an error `outlier` (radians) lose weight. Where all have
        next to none, as across a jump, the step is that of `chosen`.
        """
        system = System.empty(self.shape)

        def fill(rows: slice) -> None:
            for e in self.edges(chosen, rows):
                weight = e.wi + e.wj
                x = e.wi / np.maximum(weight, TINY)
                p = x + 4 * x * (1 - x) * (np.float32(0.5) - x)
                slope = p * e.bi / e.ai + (1 - p) * e.bj / e.aj
                si, sj = e.ai**2, e.aj**2
                precision = np.minimum(si, sj) / (np.maximum(si, sj) * np.hypot(p / si, (1 - p) / sj))
                i, j = ENDS[e.axis]
                dz = z[max(rows.start - 1, 0) : rows.stop + e.axis]
                dz = (dz[j] - dz[i]).astype(np.float32)
                c = weight * precision**2 / (1 + ((dz - slope) * precision / np.float32(outlier)) ** 2)
                held = HELD * (weight > 0)
                system.add(e, c + held, c * slope + held * e.dz)

        each_band(fill, *self.shape)
        return system
