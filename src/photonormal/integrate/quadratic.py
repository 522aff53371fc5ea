"""Least squares on any mask: the quadratic integration of Quéau, Durou, Aujol's survey (JMIV 60, 2018)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import cg

from photonormal.integrate.equations import divergence, equations, laplacian, surface
from photonormal.types import Normals, Surface


@dataclass(frozen=True)
class Quadratic:
    """z = argmin sum over neighbours of (z_j - z_i - s_i)^2 + (z_j - z_i - s_j)^2 with the slopes s = b / a.

    Smooth surfaces of any outline, in parts and with holes; steps in depth are smoothed over.

    Parameters
    ----------
    tolerance : relative residual at which the solver stops
    """

    tolerance: float = 1e-5

    def __call__(self, normals: Normals, K: np.ndarray | None) -> Surface:
        e = equations(normals, K)
        slope = (e.bi / e.ai + e.bj / e.aj) / 2
        z = solved(laplacian(e, np.ones(len(e.i))), divergence(e, slope), self.tolerance)
        return surface(normals, z, e, K)


def solved(
    A: csr_matrix,
    b: Float[np.ndarray, " n"],
    tolerance: float,
    start: Float[np.ndarray, " n"] | None = None,
) -> Float[np.ndarray, " n"]:
    """A z = b by conjugate gradients, preconditioned by one cycle of algebraic multigrid."""
    import pyamg

    cycle = pyamg.ruge_stuben_solver(A, max_coarse=500).aspreconditioner()
    z, _ = cg(A, b, x0=start, rtol=tolerance, maxiter=1000, M=cycle)
    return z
