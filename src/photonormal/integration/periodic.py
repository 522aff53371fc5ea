"""Poisson integration by Fourier transforms, for textures that repeat: R. Frankot, R. Chellappa, TPAMI 10(4), 1988."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.fft import irfft2, rfft2
from scipy.ndimage import label
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from photonormal.integration.conjugate import conjugate_gradients
from photonormal.integration.slopes import part_means, steps
from photonormal.resources import cores
from photonormal.types import InputError, Normals, Surface


@dataclass(frozen=True)
class Periodic:
    """Least squares over a tile whose right edge meets its left one, and whose lower edge meets its upper one.

    In closed form where every pixel has a normal. What slopes add up to from edge to edge, which no tile can have, is
    spread over all of them. Orthographic views only.

    Parameters
    ----------
    grazing : least cosine between a normal and its viewing ray, (0, 1)
    tolerance : residual, relative to the right-hand side, at which the iteration around holes stops
    """

    grazing: float = 0.05
    tolerance: float = 1e-6

    def __call__(self, normals: Normals, K: np.ndarray | None = None) -> Surface:
        if K is not None:
            raise InputError("a camera matrix came for a tile but one that repeats has no perspective; leave it out.")
        mask = normals.mask
        a = np.where(mask, np.maximum(normals.map[..., 2].astype(np.float64), self.grazing), 0)
        right, down = (mask & np.roll(mask, -1, axis) for axis in (1, 0))
        f = np.zeros(mask.shape)
        for k, sign, joined, axis in ((0, -1.0, right, 1), (1, 1.0, down, 0)):  # y of the picture runs against ours
            g = steps(sign * normals.map[..., k].astype(np.float64), a, joined, axis)
            f += g
            f -= np.roll(g, 1, axis)
        del a, g
        z = periodic_poisson(f)
        if not mask.all():

            def laplacian(z: np.ndarray, rows: slice) -> np.ndarray:
                around = np.arange(rows.start - 1, rows.stop + 1) % len(z)
                z, right_, down_ = z[around], right[around], down[around]
                gx, gy = right_ * (z - np.roll(z, -1, 1)), down_[:-1] * (z[:-1] - z[1:])
                return (gx - np.roll(gx, 1, 1))[1:-1] + gy[1:] - gy[:-1]

            z, _ = conjugate_gradients(laplacian, -f, z, lambda r: periodic_poisson(-r), self.tolerance, most=2000)
        parts = repeated_parts(mask)
        z -= part_means(parts, lambda y: z[y])[parts]
        return Surface(np.where(mask, z, np.nan).astype(np.float32), mask)


def repeated_parts(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """Numbers of the connected parts of a tile whose edges meet."""
    found = np.zeros(mask.shape, np.int32)
    label(mask, output=found)
    ends = [(found[:, -1], found[:, 0]), (found[-1], found[0])]
    a, b = (np.concatenate([end[k][(end[0] > 0) & (end[1] > 0)] for end in ends]) for k in (0, 1))
    joined = csr_matrix((np.ones(len(a)), (a, b)), (int(found.max()) + 1,) * 2)
    return connected_components(joined, directed=False)[1][found]


def periodic_poisson(f: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """z with div grad z = f (five-point, periodic), of mean zero; the mean of `f` is ignored."""
    h, w = f.shape
    v, u = (2 * np.cos(2 * np.pi * np.arange(m) / n) - 2 for m, n in ((h, h), (w // 2 + 1, w)))
    eigenvalues = v[:, None] + u
    eigenvalues[0, 0] = np.inf
    return np.asarray(irfft2(np.asarray(rfft2(f, workers=cores())) / eigenvalues, f.shape, workers=cores()))
