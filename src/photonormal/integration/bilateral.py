"""Depth that may jump: X. Cao, H. Santo, B. Shi, F. Okura, Y. Matsushita, "Bilateral normal integration", ECCV 2022.

Written from the paper's equations; the last solve is our own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from photonormal.integration.graph import LaggedSolver, PixelGraph
from photonormal.integration.slopes import Slopes, surface
from photonormal.types import InputError, Normals, Surface


@dataclass(frozen=True)
class Bilateral:
    """Every pixel trusts the smoother of its two sides, along rows and along columns.

    At pixel i the surface is differentiable from one side at least: a D+ z = b towards the next pixel has weight
    w = sigmoid(k ((a D- z)^2 - (a D+ z)^2)), a D- z = b towards the last one has 1 - w (a missing neighbour counts as
    no step). Weighted least squares and weights alternate, from w = 1/2. At a jump both pixels look away from it.

    The one-sided equations find the jumps, but are of first order where the surface bends. The last solve (`midpoint`)
    keeps the weights and takes the mean slope of both ends instead, a_i a_j (z_j - z_i) = (a_j b_i + a_i b_j) / 2.

    Parameters
    ----------
    k : sharpness of the choice between the two sides; 0 is plain weighted least squares, 2 the paper's value
    grazing : least cosine between a normal and its viewing ray, (0, 1)
    tolerance : relative change of the energy at which the alternation stops
    rounds : most alternations
    midpoint : False gives the paper's method
    """

    k: float = 2.0
    grazing: float = 0.01
    tolerance: float = 1e-4
    rounds: int = 150
    midpoint: bool = True

    def __post_init__(self) -> None:
        if not (self.k >= 0 and self.rounds >= 1):
            raise InputError(f"k is {self.k} and rounds {self.rounds}; k >= 0 and at least one round are needed.")

    def __call__(self, normals: Normals, K: np.ndarray | None = None) -> Surface:
        slopes = Slopes(normals, K, self.grazing)
        mask = slopes.mask
        graph = PixelGraph(mask)
        i, j, axis = graph.i, graph.j, graph.axis
        a, b = (v[..., mask] for v in slopes.rows(0, len(mask)))  # (p,), (2, p)
        ai, aj, bi, bj = a[i], a[j], b[axis, i], b[axis, j]  # (e,) at both ends of every edge
        solver = LaggedSolver(graph)

        z, energy = np.zeros(len(a)), np.inf
        wi = wj = np.full(len(i), 0.5)  # weight of i's equation towards j, and of j's towards i
        for _ in range(self.rounds):
            z = solver(wi * ai**2 + wj * aj**2, wi * ai * bi + wj * aj * bj, z, rtol=1e-4)
            dz = graph.D @ z
            before, energy = energy, float((wi * (ai * dz - bi) ** 2 + wj * (aj * dz - bj) ** 2).sum())
            if abs(before - energy) <= self.tolerance * energy:
                break
            wi, wj = self.weights(graph, (ai * dz) ** 2, (aj * dz) ** 2)
        if self.midpoint:
            w = wi + wj
            z = solver(w * (ai * aj) ** 2, w * ai * aj * (aj * bi + ai * bj) / 2, z, rtol=1e-6)
        found = np.zeros(mask.shape)
        found[mask] = z
        return surface(found, slopes)

    def weights(
        self, graph: PixelGraph, next_step: Float[np.ndarray, " e"], last_step: Float[np.ndarray, " e"]
    ) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, " e"]]:
        """w of each edge's first pixel, 1 - w of its second, from the steps (a D z)^2 as either end sees them."""
        plus, minus = np.zeros((2, 2, graph.pixels))  # (2, p) along x and along y
        plus[graph.axis, graph.i] = next_step
        minus[graph.axis, graph.j] = last_step
        w = expit(self.k * (minus - plus))  # (2, p)
        return w[graph.axis, graph.i], 1 - w[graph.axis, graph.j]
