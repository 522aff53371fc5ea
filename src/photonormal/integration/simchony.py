"""Poisson integration by cosine transforms: T. Simchony, R. Chellappa, M. Shao, IEEE TPAMI 12(5), 1990."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.fft import dctn, idctn, next_fast_len

from photonormal.integration.slopes import Slopes, surface
from photonormal.resources import cores
from photonormal.types import Normals, Surface


@dataclass(frozen=True)
class Simchony:
    """Least squares over the whole bounding rectangle of the mask, in closed form.

    The fastest method, and exact where the mask is a rectangle. Elsewhere slopes count as zero off the mask, which
    bends the surface near the mask's border.

    Parameters
    ----------
    grazing : least cosine between a normal and its viewing ray, (0, 1)
    """

    grazing: float = 0.05

    def __call__(self, normals: Normals, K: np.ndarray | None = None) -> Surface:
        slopes = Slopes(normals, K, self.grazing)
        return surface(closed_poisson(slopes.divergence(), exact=bool(slopes.mask.all())), slopes)


def closed_poisson(f: Float[np.ndarray, "h w"], exact: bool) -> Float[np.ndarray, "h w"]:
    """z with div grad z = f (five-point, no flow through the border), up to a constant; the mean of `f` is ignored.

    Cosines are the eigenvectors: z^ = f^ / ((2 cos(pi u / w) - 2) + (2 cos(pi v / h) - 2)). Unless `exact`, the border
    moves outwards, the same way on every side, to where the transform is fast: primes are 15 times slower. In the
    precision of `f`.
    """
    pads = [(0, 0) if exact else padding(n) for n in f.shape]
    F: np.ndarray = np.asarray(dctn(np.pad(f, pads), workers=cores(), overwrite_x=True))
    v, u = (2 * np.cos(np.pi * np.arange(n) / n) - 2 for n in F.shape)
    for row, eigenvalue in zip(F, v, strict=True):
        eigenvalues = (eigenvalue + u).astype(F.dtype)
        np.divide(row, eigenvalues, out=row, where=eigenvalues < 0)
    F[0, 0] = 0
    z = np.asarray(idctn(F, workers=cores(), overwrite_x=True))
    return z[tuple(slice(before, n - after) for (before, after), n in zip(pads, z.shape, strict=True))]


def padding(n: int) -> tuple[int, int]:
    """How much to add before and after `n` samples, the same on both sides, for a fast transform."""
    fast = n
    while next_fast_len(fast) != fast:
        fast += 2
    return (fast - n) // 2, (fast - n) // 2
