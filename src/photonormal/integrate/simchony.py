"""Poisson's equation on a rectangle by cosine transforms: Simchony, Chellappa, Shao, TPAMI 12(5), 1990."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import dctn, idctn

from photonormal.integrate.equations import equations, surface
from photonormal.types import Normals, Surface


@dataclass(frozen=True)
class Simchony:
    """The least-squares surface over the mask's bounding rectangle, level outside the mask: by far the fastest.

    Exact where the mask fills the rectangle; elsewhere the level surroundings bend the surface near the outline.
    """

    def __call__(self, normals: Normals, K: np.ndarray | None) -> Surface:
        e = equations(normals, K)
        rows, columns = np.nonzero(normals.mask)
        rows, columns = rows - rows.min(), columns - columns.min()
        h, w = rows.max() + 1, columns.max() + 1
        slope = (e.bi / e.ai + e.bj / e.aj) / 2  # z_j - z_i
        divergence = np.zeros((h, w))
        into = np.bincount(e.j, slope, e.n) - np.bincount(e.i, slope, e.n)
        divergence[rows, columns] = -into
        # laplacian(z) = divergence with natural boundaries; its eigenvectors are cosines
        u, v = np.arange(w), np.arange(h)[:, None]
        eigenvalues = (2 * np.cos(np.pi * u / w) - 2) + (2 * np.cos(np.pi * v / h) - 2)
        eigenvalues[0, 0] = 1
        z = dctn(divergence, workers=-1) / eigenvalues
        z[0, 0] = 0
        return surface(normals, idctn(z, workers=-1)[rows, columns], e, K)
