"""Discontinuities by bilateral weights: Cao, Santo, Shi, Okura, Matsushita, "Bilateral normal integration", ECCV 2022."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from photonormal.integrate.equations import Equations, divergence, equations, laplacian, surface
from photonormal.integrate.quadratic import solved
from photonormal.types import Normals, Surface


@dataclass(frozen=True)
class Bilateral:
    """Each pixel trusts its normal's slope towards the side on which the surface goes on, not across a step in depth.

    Minimises sum w (a dz - b)^2 over every pixel's two neighbours along each axis, where the weights of the two sides
    sum to one: w = sigmoid(k ((a dz of the other side)^2 - (a dz of this side)^2)), found by reweighting.

    Parameters
    ----------
    k : how sharply the sides are told apart
    rounds : reweightings at most
    change : relative change of the energy at which they stop
    tolerance : relative residual of each linear solve
    """

    k: float = 2.0
    rounds: int = 100
    change: float = 1e-4
    tolerance: float = 1e-5

    def __call__(self, normals: Normals, K: np.ndarray | None) -> Surface:
        e = equations(normals, K)
        wi = wj = np.full(len(e.i), 0.5)  # of the equation of i towards j, and of j towards i
        z, energy = None, 0.0
        for _ in range(self.rounds):
            A = laplacian(e, wi * e.ai**2 + wj * e.aj**2)
            z = solved(A, divergence(e, wi * e.ai * e.bi + wj * e.aj * e.bj), self.tolerance, z)
            dz = z[e.j] - z[e.i]
            before, energy = energy, float((wi * (e.ai * dz - e.bi) ** 2 + wj * (e.aj * dz - e.bj) ** 2).sum())
            if abs(before - energy) <= self.change * before:
                break
            wi, wj = self.weights(e, dz)
        assert z is not None
        return surface(normals, z, e, K)

    def weights(
        self, e: Equations, dz: Float[np.ndarray, " e"]
    ) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, " e"]]:
        """Weights of both equations of each pair; a side without a neighbour counts as level."""
        after, behind = np.zeros((2, e.n)), np.zeros((2, e.n))  # (a dz)^2 towards the right or below, and the left or above
        after[e.axis, e.i] = (e.scale * e.ai * dz) ** 2
        behind[e.axis, e.j] = (e.scale * e.aj * dz) ** 2
        w = expit(self.k * (behind - after))  # of the side to the right or below
        return w[e.axis, e.i], 1 - w[e.axis, e.j]
