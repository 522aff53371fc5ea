"""Between a grid and the coarser one: J. E. Dendy, "Black box multigrid", J. Comput. Phys. 48, 1982."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from photonormal.integration.bands import around, each_band
from photonormal.integration.grid import FIRST, LAST, TINY, Grid, Weights

CORNERS = (FIRST, FIRST), (FIRST, LAST), (LAST, FIRST), (LAST, LAST)


class Interpolation(NamedTuple):
    """From every second row and column of a grid to all; or of some rows.

    west : (H, W - 1) share of the coarse pixel to the left in the pixel between it and the one to the right
    north : (H - 1, W) share of the coarse pixel above in the pixel between it and the one below
    corners : four (H - 1, W - 1), shares of the coarse pixels around in the pixel between all of them
    """

    west: Weights
    north: Weights
    corners: tuple[Weights, ...]

    @classmethod
    def of(cls, grid: Grid) -> Interpolation:
        H, W = (n // 2 + 1 for n in grid.inverse.shape)
        west, north = np.empty((H, W - 1), np.float32), np.empty((H - 1, W), np.float32)
        whole = cls(west, north, tuple(np.empty((H - 1, W - 1), np.float32) for _ in CORNERS))

        def fill(rows: slice) -> None:
            part, own = around(rows, H, 2)
            for every, some in zip((west, north, *whole.corners), shares(grid.part(fine(part))), strict=True):
                every[rows] = some[own]

        each_band(fill, H, W)
        return whole

    def part(self, rows: slice) -> Interpolation:
        """Some coarse rows and what lies between them."""
        across = slice(rows.start, rows.stop - 1)
        return Interpolation(self.west[rows], self.north[across], tuple(c[across] for c in self.corners))

    def add_prolonged(self, v: Float[np.ndarray, "H W"], z: Float[np.ndarray, "h w"]) -> None:
        """Add the values of all pixels to `z`."""
        H, W = len(self.west), self.north.shape[1]

        def add(rows: slice) -> None:
            part = slice(rows.start, min(rows.stop + 1, H))
            some = self.part(part).prolonged(v[part])
            own = z[2 * rows.start : min(2 * rows.stop, len(z))]
            own += some[: len(own)]

        each_band(add, H, 4 * W)

    def restricted(self, r: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "H W"]:
        """The adjoint of `prolonged`, with a row or a column of zeros added where there is an even number."""
        H, W = len(self.west), self.north.shape[1]
        out = np.zeros((H | 1, W | 1), np.float32)

        def restrict(rows: slice) -> None:
            part, own = around(rows, H)
            out[rows, :W] = self.part(part).adjoint(r[fine(part)])[own]

        each_band(restrict, H, 4 * W)
        return out

    def prolonged(self, v: Float[np.ndarray, "H W"]) -> Float[np.ndarray, "h w"]:
        """The values of all pixels."""
        v = v[: len(self.west), : self.north.shape[1]]
        out = np.empty((2 * len(v) - 1, 2 * v.shape[1] - 1), np.float32)
        out[::2, ::2] = v
        out[::2, 1::2] = v[:, 1:] - self.west * np.diff(v, axis=1)
        out[1::2, ::2] = v[1:] - self.north * np.diff(v, axis=0)
        centre = self.corners[0] * v[:-1, :-1]
        for shares, corner in zip(self.corners[1:], CORNERS[1:], strict=True):
            centre += shares * v[corner]
        out[1::2, 1::2] = centre
        return out

    def adjoint(self, r: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "H W"]:
        """Of `prolonged`."""
        v = r[::2, ::2].copy()
        between = r[::2, 1::2]
        part = self.west * between
        v[:, :-1] += part
        v[:, 1:] += between - part
        between = r[1::2, ::2]
        part = self.north * between
        v[:-1] += part
        v[1:] += between - part
        between = np.ascontiguousarray(r[1::2, 1::2])
        for shares, corner in zip(self.corners, CORNERS, strict=True):
            v[corner] += shares * between
        return v

    def coarse(self, grid: Grid) -> Grid:
        """The grid of every second row and column whose energy is that of `grid` after interpolation."""
        H, W = len(self.west), self.north.shape[1]
        shapes = (H, W - 1), (H - 1, W), (H - 1, W - 1), (H - 1, W - 1)
        found = [np.empty(shape, np.float32) for shape in shapes]

        def fill(rows: slice) -> None:
            part, own = around(rows, H)
            for every, some in zip(found, galerkin(grid.part(fine(part)), self.part(part)), strict=True):
                every[rows] = some[own]

        each_band(fill, H, 4 * W)
        return Grid.of(*found)


def fine(rows: slice) -> slice:
    """The rows of a grid from the first to the last of some rows of the next coarser one."""
    return slice(2 * rows.start, 2 * rows.stop - 1)


def shares(grid: Grid) -> list[Weights]:
    """West, north and the four corners of `Interpolation`; of some rows of a grid: but for the first and the last.

    Weights below zero, which coarser grids may have, count as none: shares are 0 to 1.
    """
    E, S, *diagonals = (c.clip(0) for c in grid.weights)
    west, east, north, south = E[::2, ::2], E[::2, 1::2], S[::2, ::2], S[1::2, ::2]
    straight, inverse = [S[::2, 1::2], E[1::2, ::2], E[1::2, 1::2], S[1::2, 1::2]], grid.inverse[1::2, 1::2]
    aslant = []
    if diagonals:  # the column to a pixel's left acts as one neighbour, as Dendy has it
        D, U = diagonals
        aslant = [D[::2, ::2], U[::2, 1::2], U[1::2, ::2], D[1::2, 1::2]]
        total = sum(aslant, sum(straight[1:], straight[0]))
        inverse = np.divide(1, total, out=np.zeros_like(total), where=total > TINY)
        west, east, north, south = (c.copy() for c in (west, east, north, south))
        west[:-1] += U[::2, ::2]
        west[1:] += D[1::2, ::2]
        east[:-1] += D[::2, 1::2]
        east[1:] += U[1::2, 1::2]
        north[:, 1:] += D[::2, 1::2]
        north[:, :-1] += U[::2, ::2]
        south[:, 1:] += U[1::2, 1::2]
        south[:, :-1] += D[1::2, ::2]
    w, n = share(west, east), share(north, south)
    up, left, right, below = (c * inverse for c in straight)
    corners = [
        up * w[:-1] + left * n[:, :-1],
        up * (1 - w[:-1]) + right * n[:, 1:],
        below * w[1:] + left * (1 - n[:, :-1]),
        below * (1 - w[1:]) + right * (1 - n[:, 1:]),
    ]
    for corner, c in zip(corners, aslant, strict=False):  # the finest grid has none
        corner += c * inverse
    return [w, n, *corners]


def galerkin(grid: Grid, between: Interpolation) -> tuple[Weights, Weights, Weights, Weights]:
    """Weights of the coarser grid's edges; of some rows of a grid: but for the first and the last."""
    E, S, *diagonals = grid.weights
    w, n = between.west, between.north
    top, bottom = (w[:-1], 1 - w[:-1], 0, 0), (0, 0, w[1:], 1 - w[1:])  # shares of the corners in what lies between
    left, right = (n[:, :-1], 0, 1 - n[:, :-1], 0), (0, n[:, 1:], 0, 1 - n[:, 1:])
    east = E[::2, ::2] * (1 - w) ** 2 + E[::2, 1::2] * w**2
    south = S[::2, ::2] * (1 - n) ** 2 + S[1::2, ::2] * n**2
    down = np.zeros(between.corners[0].shape, np.float32)
    up = np.zeros_like(down)

    def add(c: np.ndarray, p: Any, q: Any) -> None:
        """An edge within the cells between pixels of shares p and q: c ((p - q) . corners)^2."""
        nw, ne, sw, se = (x - y for x, y in zip(p, q, strict=True))
        first, last = c * nw, c * se
        east[:-1] -= first * ne
        east[1:] -= last * sw
        south[:, :-1] -= first * sw
        south[:, 1:] -= last * ne
        np.subtract(down, first * se, out=down)
        np.subtract(up, c * ne * sw, out=up)

    middle = between.corners
    add(S[::2, 1::2], middle, top)
    add(S[1::2, 1::2], middle, bottom)
    add(E[1::2, ::2], middle, left)
    add(E[1::2, 1::2], middle, right)
    if diagonals:
        D, U = diagonals
        for k, c in enumerate((D[::2, ::2], U[::2, 1::2], U[1::2, ::2], D[1::2, 1::2])):
            add(c, middle, [float(k == other) for other in range(4)])
        add(U[::2, ::2], top, left)
        add(D[::2, 1::2], top, right)
        add(D[1::2, ::2], bottom, left)
        add(U[1::2, 1::2], bottom, right)
    return east, south, down, up


def share(a: Weights, b: Weights) -> Weights:
    """a / (a + b); a half where both are none."""
    total = a + b
    return np.divide(a, total, out=np.full_like(total, 0.5), where=total > TINY)
