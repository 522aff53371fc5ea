"""Preconditioned conjugate gradients: M. R. Hestenes, E. Stiefel, J. Res. NBS 49(6), 1952."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Operator = Callable[[np.ndarray], np.ndarray]


def conjugate_gradients(
    A: Operator,
    b: Float[np.ndarray, " n"],
    z: Float[np.ndarray, " n"],
    M: Operator,
    tolerance: float,
    most: int,
) -> tuple[Float[np.ndarray, " n"], bool]:
    """z with A z = b from a start `z`, and whether |b - A z| came to `tolerance` |b| within `most` iterations.

    A must be symmetric and not negative; it may be singular (a free constant) where b has no part in its null space. M
    is a symmetric positive approximation of its inverse.
    """
    r = b - A(z)
    enough = tolerance**2 * dot(b, b)
    s = M(r)
    p, rs = s, dot(r, s)
    for _ in range(most):
        if dot(r, r) <= enough:
            return z, True
        q = A(p)
        step = rs / dot(p, q)
        z, r = z + step * p, r - step * q
        s = M(r)
        before, rs = rs, dot(r, s)
        p = s + (rs / before) * p
    return z, dot(r, r) <= enough


def dot(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> float:
    """Not `x @ y`: the threads that it starts for each product cost more than they save."""
    return float(np.einsum("i,i", x, y))
