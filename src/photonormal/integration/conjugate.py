"""Preconditioned conjugate gradients: M. R. Hestenes, E. Stiefel, J. Res. NBS 49(6), 1952."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from photonormal.integration.bands import each_band

Operator = Callable[[np.ndarray, slice], np.ndarray]  # z and some rows to these rows of A z
ANEW = 1e-3  # fall of the residual after which it is taken from the solution: single precision loses it by then


def conjugate_gradients(
    A: Operator,
    b: Float[np.ndarray, "h w"],
    z: Float[np.ndarray, "h w"],
    M: Callable[[np.ndarray], np.ndarray],
    tolerance: float,
    most: int,
    precision: type[np.floating] = np.float64,
) -> tuple[Float[np.ndarray, "h w"], bool]:
    """z with A z = b from a start `z`, and whether |b - A z| came to `tolerance` |b| within `most` iterations.

    A must be symmetric and not negative; it may be singular (a free constant) where b has no part in its null space. M
    is a symmetric positive approximation of its inverse. The solution, which is written into `z`, is double
    precision. Directions and residuals may be single: the residual is taken anew from time to time (H. van der Vorst,
    Q. Ye, SIAM J. Sci. Comput. 22(3), 2000), so that the solution is as exact as if all were double.
    """

    def summed(work: Callable[[slice], float]) -> float:
        return sum(each_band(work, *b.shape))

    def anew(rows: slice) -> float:
        np.subtract(b[rows], A(z, rows), out=r[rows], casting="same_kind")
        return dot(r[rows], r[rows])

    def applied(rows: slice) -> float:
        q[rows] = A(p, rows)
        return dot(p[rows], q[rows])

    def onwards(rows: slice) -> float:
        q[rows] *= step
        r[rows] -= q[rows]
        z[rows] += np.multiply(p[rows], step, out=q[rows])
        return dot(r[rows], r[rows])

    def along(rows: slice) -> float:
        return dot(r[rows], s[rows])

    def turned(rows: slice) -> None:
        p[rows] *= share
        p[rows] += s[rows]

    enough = tolerance**2 * summed(lambda rows: dot(b[rows], b[rows]))
    r = np.empty(b.shape, precision)
    begun = left = summed(anew)
    if left <= enough:
        return z, True
    s = p = M(r)
    q = np.empty_like(r)
    rs = summed(along)
    for _ in range(most):
        step = precision(rs / summed(applied))
        left = summed(onwards)
        if left <= enough or left <= ANEW**2 * begun:
            begun = left = summed(anew)
        if left <= enough:
            return z, True
        del s  # before its successor is made
        s = M(r)
        before, rs = rs, summed(along)
        share = precision(rs / before)
        each_band(turned, *b.shape)
    return z, False


def dot(x: Float[np.ndarray, "k w"], y: Float[np.ndarray, "k w"]) -> float:
    """Of some rows. Not `x @ y`: the threads that it starts cost more than they save."""
    return float(np.einsum("ij,ij", x, y))
