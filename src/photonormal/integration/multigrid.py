"""Multigrid for weights that jump: J. E. Dendy, "Black box multigrid", J. Comput. Phys. 48, 1982."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from photonormal.integration.bands import around, each_band
from photonormal.integration.grid import Grid, Weights, padded
from photonormal.integration.interpolation import Interpolation

DIRECT = 150  # pixels of a grid that is solved directly
DAMPING = np.float32(0.8)  # of the Jacobi steps


class Multigrid:
    """About the inverse of -div(c grad z), as one V-cycle in single precision.

    Each grid has every second row and column of the one before. What lies between is interpolated by the weights of its
    own equation, so that nothing is carried across a jump, where they vanish; the coarse grid's weights are those of
    the same energy (Galerkin). One Jacobi step before and one after.

    Parameters
    ----------
    cx, cy : (h, w - 1) and (h - 1, w), weights >= 0 of the edges to the right and of those down
    """

    def __init__(self, cx: Weights, cy: Weights) -> None:
        self.shape = len(cx), cy.shape[1]
        grid = Grid.of(cx, cy)
        self.levels: list[tuple[Grid, Interpolation]] = []
        while grid.inverse.size > DIRECT:
            between = Interpolation.of(grid)
            self.levels.append((grid, between))
            grid = between.coarse(grid)
        self.coarsest = grid.pseudo_inverse()

    def __call__(self, r: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
        """z with about -div(c grad z) = r."""
        h, w = self.shape
        return np.ascontiguousarray(self.cycle(padded(r, h | 1, w | 1), 0)[:h, :w])

    def cycle(self, r: Float[np.ndarray, "h w"], level: int) -> Float[np.ndarray, "h w"]:
        if level == len(self.levels):
            return (self.coarsest @ r.ravel()).reshape(r.shape)
        grid, between = self.levels[level]
        z, left = np.empty_like(r), np.empty_like(r)

        def before(rows: slice) -> None:
            part, own = around(rows, len(r))
            some = grid.part(part)
            begun = some.inverse * r[part]
            begun *= DAMPING
            z[rows] = begun[own]
            np.add(r[rows], some.flow(begun)[own], out=left[rows])

        def after(rows: slice) -> None:
            part, own = around(rows, len(r))
            step = grid.part(part).flow(z[part])[own]
            step += r[rows]
            step *= grid.inverse[rows]
            step *= DAMPING
            np.add(z[rows], step, out=left[rows])

        each_band(before, *r.shape)
        between.add_prolonged(self.cycle(between.restricted(left), level + 1), z)
        each_band(after, *r.shape)
        return left
