"""What every method solves: each pixel's normal says how the surface goes on to its four neighbours.

    a_p (z_q - z_p) = b_p        for a pixel p and a neighbour q to its right or below, and the same with q's own a and b

Orthographic: z is the height in pixels, a = n_z, b = -n_x to the right and n_y downwards. Perspective: z is the
logarithm of the distance along the optical axis; with the ray r = ((u - c_x) / f_x, -(v - c_y) / f_y, -1) through a
pixel, the point exp(z) r has the tangent exp(z) (z_u r + r_u), so that a = -n.r and b = n.r_u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.csgraph import connected_components

from photonormal.types import Normals, Surface

GRAZING = 0.13  # least a: steeper normals say little about the slope and much about noise


@dataclass(frozen=True)
class Equations:
    """The pairs of neighbours in a mask of `n` pixels, horizontal ones first, and both pixels' coefficients.

    `i` is left of `j`, or above it; `axis` is 0 for horizontal pairs and 1 for vertical ones. `scale` is the length in
    pixels that a step of 1 in z stands for.
    """

    n: int
    i: Int[np.ndarray, " e"]
    j: Int[np.ndarray, " e"]
    axis: Int[np.ndarray, " e"]
    ai: Float[np.ndarray, " e"]
    aj: Float[np.ndarray, " e"]
    bi: Float[np.ndarray, " e"]
    bj: Float[np.ndarray, " e"]
    scale: float


def equations(normals: Normals, K: np.ndarray | None) -> Equations:
    """The equations of a normal map; `a` and `b` as in the module's docstring."""
    mask, N = normals.mask, normals.map.astype(np.float64)
    if K is None:
        a, b, scale = N[..., 2], (-N[..., 0], N[..., 1]), 1.0
    else:
        v, u = np.indices(mask.shape)
        x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
        a = N[..., 2] + N[..., 1] * y - N[..., 0] * x
        b, scale = (N[..., 0] / K[0, 0], -N[..., 1] / K[1, 1]), float(K[0, 0])
    a = np.maximum(a, GRAZING)
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(mask.sum())
    right, below = mask[:, :-1] & mask[:, 1:], mask[:-1] & mask[1:]
    i = np.concatenate([index[:, :-1][right], index[:-1][below]])
    j = np.concatenate([index[:, 1:][right], index[1:][below]])
    axis = np.repeat([0, 1], [right.sum(), below.sum()])
    a, b = a[mask], np.stack([b[0][mask], b[1][mask]])  # (n,), (2, n)
    return Equations(len(a), i, j, axis, a[i], a[j], b[axis, i], b[axis, j], scale)


def laplacian(e: Equations, weight: Float[np.ndarray, " e"]) -> csr_matrix:
    """The matrix of sum_e weight_e (z_j - z_i)^2, with a trace of the identity that makes it regular."""
    both = np.concatenate([weight, weight])
    W = coo_matrix((both, (np.concatenate([e.i, e.j]), np.concatenate([e.j, e.i]))), (e.n, e.n)).tocsr()
    degree = np.asarray(W.sum(1)).ravel()
    return (diags(degree + 1e-9 * max(float(degree.max(initial=0)), 1e-12)) - W).tocsr()


def divergence(e: Equations, flow: Float[np.ndarray, " e"]) -> Float[np.ndarray, " n"]:
    """What flows along the pairs into each pixel: the right-hand side that goes with `laplacian`."""
    return np.bincount(e.j, flow, e.n) - np.bincount(e.i, flow, e.n)


def surface(normals: Normals, z: Float[np.ndarray, " n"], e: Equations, K: np.ndarray | None) -> Surface:
    """`z` as a Surface: zero on average in each connected part, the exponential of it in a perspective view."""
    ones = np.ones(len(e.i))
    _, part = connected_components(coo_matrix((ones, (e.i, e.j)), (e.n, e.n)), directed=False)
    z = z - (np.bincount(part, z) / np.bincount(part))[part]
    depth = np.full(normals.mask.shape, np.nan, np.float64)
    depth[normals.mask] = z if K is None else np.exp(z)
    return Surface(depth, normals.mask, K)
