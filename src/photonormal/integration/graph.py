"""The pixels of a mask as a graph, and weighted least squares on it."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse

from photonormal.integration.conjugate import Operator, conjugate_gradients
from photonormal.integration.slopes import pairs


class PixelGraph:
    """Neighbouring pixels of a mask: `e` edges among `p` pixels, numbered row by row.

    i, j : (e,) the two pixels of an edge; j is right of i (axis 0) or below it (axis 1)
    D : (e, p) differences, (D z)_e = z_j - z_i; Dt its transpose
    """

    def __init__(self, mask: Bool[np.ndarray, "h w"]) -> None:
        number = np.cumsum(mask, dtype=np.int32).reshape(mask.shape) - 1
        right, down = pairs(mask)
        self.pixels = int(mask.sum())
        self.i = np.concatenate([number[:, :-1][right], number[:-1][down]])
        self.j = np.concatenate([number[:, 1:][right], number[1:][down]])
        self.axis = np.repeat([0, 1], [right.sum(), down.sum()])
        e = len(self.i)
        ends, starts = np.stack([self.i, self.j], axis=1).ravel(), np.arange(0, 2 * e + 1, 2, dtype=np.int32)
        self.D = sparse.csr_matrix((np.tile([-1.0, 1.0], e), ends, starts), shape=(e, self.pixels))
        self.Dt = self.D.T.tocsr()


class LaggedSolver:
    """min sum c_e (z_j - z_i)^2 - 2 flow_e (z_j - z_i), many times with weights that change little.

    Conjugate gradients from the last solution. The preconditioner, a cycle of algebraic multigrid, is built for the
    weights of some earlier call, and anew once it needs more than `patience` iterations.
    """

    def __init__(self, graph: PixelGraph, patience: int = 10) -> None:
        self.graph, self.patience = graph, patience
        self.multigrid: Operator | None = None

    def __call__(
        self, c: Float[np.ndarray, " e"], flow: Float[np.ndarray, " e"], z: Float[np.ndarray, " p"], rtol: float
    ) -> Float[np.ndarray, " p"]:
        """z from the weights `c` >= 0, starting at `z`, to a residual of `rtol` relative to the right-hand side."""
        D, Dt = self.graph.D, self.graph.Dt
        rhs = Dt @ flow
        if not rhs.any():
            return np.zeros_like(z)
        if self.multigrid is None:
            self.multigrid = self.build(c)

        def A(x: np.ndarray) -> np.ndarray:
            return Dt @ (c * (D @ x))

        z, done = conjugate_gradients(A, rhs, z, self.multigrid, rtol, self.patience)
        if not done:
            self.multigrid = self.build(c)
            z, _ = conjugate_gradients(A, rhs, z, self.multigrid, rtol, most=500)
        return z

    def build(self, c: Float[np.ndarray, " e"]) -> Operator:
        """One V-cycle for D' C D, which a trace of the identity makes definite; it only guides the iteration."""
        import pyamg

        A = self.graph.Dt @ sparse.diags(c + 1e-9) @ self.graph.D + 1e-9 * sparse.identity(self.graph.pixels)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pyamg's own, about nothing that a user could change
            hierarchy = pyamg.ruge_stuben_solver(
                sparse.csr_matrix(A),
                presmoother=("gauss_seidel", {"sweep": "forward"}),
                postsmoother=("gauss_seidel", {"sweep": "backward"}),
            )

        levels: list[Any] = hierarchy.levels

        def cycle(b: np.ndarray, depth: int = 0) -> np.ndarray:  # pyamg's own also takes norms, which costs as much
            level = levels[depth]
            if depth == len(levels) - 1:
                return hierarchy.coarse_solver(level.A, b)
            x = np.zeros_like(b)
            level.presmoother(level.A, x, b)
            x += level.P @ cycle(level.R @ (b - level.A @ x), depth + 1)
            level.postsmoother(level.A, x, b)
            return x

        return cycle
