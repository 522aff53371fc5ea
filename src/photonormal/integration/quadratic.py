"""Least squares over the pixels of any mask: Y. Queau, J.-D. Durou, J.-F. Aujol, JMIV 60, 2018 (survey), section 3."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from photonormal.integration.conjugate import conjugate_gradients
from photonormal.integration.simchony import closed_poisson
from photonormal.integration.slopes import Slopes, adjacent, surface, weighted_laplacian
from photonormal.types import Normals, Surface


@dataclass(frozen=True)
class Quadratic:
    """min sum (z_j - z_i - g_ij)^2 over all neighbours i, j on the mask, which may have several parts and holes.

    Smears jumps of the depth over their surroundings. Conjugate gradients with the rectangle's cosine solver
    (`simchony.closed_poisson`) as preconditioner: about ten iterations for a compact mask, more for a thin or winding
    one.

    Parameters
    ----------
    grazing : least cosine between a normal and its viewing ray, (0, 1)
    tolerance : residual, relative to the right-hand side, at which the iteration stops
    """

    grazing: float = 0.05
    tolerance: float = 1e-6

    def __call__(self, normals: Normals, K: np.ndarray | None = None) -> Surface:
        slopes = Slopes(normals, K, self.grazing)
        return surface(self.solve(slopes.mask, slopes.divergence()), slopes)

    def solve(self, mask: np.ndarray, f: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
        """z with div grad z = f where no flow crosses the border of the mask; `f` sums to zero on each of its parts."""
        right, down = adjacent(mask)
        filled = bool(mask.all())
        np.negative(f, out=f)
        start = rectangle(f, filled)
        z, _ = conjugate_gradients(
            lambda z, rows: weighted_laplacian(z, right, down, rows),
            f,
            start,
            lambda r: rectangle(r, filled),
            self.tolerance,
            most=2000,
            precision=np.float32,
        )
        return z


def rectangle(r: Float[np.ndarray, "h w"], filled: bool) -> Float[np.ndarray, "h w"]:
    """z with -div grad z = r over the whole rectangle."""
    z = closed_poisson(r, exact=filled)
    return np.ascontiguousarray(np.negative(z, out=z))
