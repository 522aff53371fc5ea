"""Preconditioned conjugate gradients: M. R. Hestenes, E. Stiefel, J. Res. NBS 49(6), 1952."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Operator = Callable[[np.ndarray], np.ndarray]
ANEW = 1e-3  # fall of the residual after which it is taken from the solution: single precision loses it by then


def conjugate_gradients(
    A: Operator,
    b: Float[np.ndarray, "*n"],
    z: Float[np.ndarray, "*n"],
    M: Operator,
    tolerance: float,
    most: int,
    precision: type[np.floating] = np.float64,
) -> tuple[Float[np.ndarray, "*n"], bool]:
    """z with A z = b from a start `z`, and whether |b - A z| came to `tolerance` |b| within `most` iterations.

    A must be symmetric and not negative; it may be singular (a free constant) where b has no part in its null space. M
    is a symmetric positive approximation of its inverse. The solution, which is written into `z`, is double
    precision. Directions and residuals may be single: the residual is taken anew from time to time (H. van der Vorst,
    Q. Ye, SIAM J. Sci. Comput. 22(3), 2000), so that the solution is as exact as if all were double.
    """

    def residual() -> Float[np.ndarray, "*n"]:
        return np.subtract(b, A(z)).astype(precision, copy=False)

    enough = tolerance**2 * dot(b, b)
    r = residual()
    begun = left = dot(r, r)
    if left <= enough:
        return z, True
    p = M(r)
    rs = dot(r, p)
    for _ in range(most):
        q = A(p)
        step = precision(rs / dot(p, q))
        q *= step
        r -= q
        z += np.multiply(p, step, out=q)
        left = dot(r, r)
        if left <= enough or left <= ANEW**2 * begun:
            r = residual()
            begun = left = dot(r, r)
        if left <= enough:
            return z, True
        s = M(r)
        before, rs = rs, dot(r, s)
        p *= precision(rs / before)
        p += s
    return z, False


def dot(x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> float:
    """Summed in double precision. Not `x @ y`: the threads that it starts cost more than they save."""
    return float(np.einsum("i,i", x.ravel(), y.ravel(), dtype=np.float64))
