"""Multigrid for weights that jump: J. E. Dendy, "Black box multigrid", J. Comput. Phys. 48, 1982."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float

BLOCK = 2**15  # pixels that are worked on at a time: what a cache holds
DIRECT = 150  # pixels of a grid that is solved directly
TINY = np.float32(1e-30)  # weights below are none
DAMPING = np.float32(0.8)  # of the Jacobi steps

Weights = Float[np.ndarray, "_ _"]
FIRST, LAST, ALL = slice(None, -1), slice(1, None), slice(None)
CORNERS = (FIRST, FIRST), (FIRST, LAST), (LAST, FIRST), (LAST, LAST)


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
        grid = Grid(cx, cy)
        self.levels: list[tuple[Grid, Interpolation]] = []
        while grid.inverse.size > DIRECT and min(grid.inverse.shape) > 3:
            between = Interpolation(grid)
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
        z = grid.inverse * r
        z *= DAMPING
        left = grid.residual(z, r)
        z += between.prolonged(self.cycle(between.restricted(left), level + 1))
        left = grid.residual(z, r, out=left)
        left *= grid.inverse
        left *= DAMPING
        z += left
        return z


class Grid:
    """-div(c grad z) where every pixel has up to eight neighbours; odd numbers of rows and columns.

    east, south, down, up : weights of the edges (y, x) - (y, x + 1), (y, x) - (y + 1, x), (y, x) - (y + 1, x + 1) and
        (y + 1, x) - (y, x + 1); the finest grid has none of the last two
    inverse : of the sum of a pixel's weights; 0 where it has none
    """

    def __init__(self, east: Weights, south: Weights, down: Weights | None = None, up: Weights | None = None) -> None:
        h, w = len(east) | 1, south.shape[1] | 1
        self.east, self.south = padded(east, h, w - 1), padded(south, h - 1, w)
        self.down, self.up = (None if c is None else padded(c, h - 1, w - 1) for c in (down, up))
        total = np.zeros((h, w), np.float32)
        for c, first, second in self.edges(slice(None), total):
            first += c
            second += c
        self.inverse = np.divide(1, total, out=np.zeros_like(total), where=total > TINY)

    def edges(self, rows: slice, *maps: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
        """Weights of the edges that begin in some rows, of one kind after the other; each map at both of their ends."""
        above = [v[rows] for v in maps]
        below = [v[1:][rows] for v in maps]
        pairs = [(self.east, (above, FIRST), (above, LAST)), (self.south, (above, ALL), (below, ALL))]
        if self.down is not None:
            pairs += [(self.down, (above, FIRST), (below, LAST)), (self.up, (below, FIRST), (above, LAST))]
        for c, (start, x0), (end, x1) in pairs:
            c = c[rows]
            yield c, *(v[: len(c), x] for p, q in zip(start, end, strict=True) for v, x in ((p, x0), (q, x1)))

    def residual(self, z: np.ndarray, r: np.ndarray, out: np.ndarray | None = None) -> Float[np.ndarray, "h w"]:
        """r + div(c grad z)."""
        out = np.empty_like(r) if out is None else out
        np.copyto(out, r)
        rows = max(1, BLOCK // z.shape[1])
        for y in range(0, len(z), rows):
            for c, z0, z1, out0, out1 in self.edges(slice(y, y + rows), z, out):
                flow = z1 - z0
                flow *= c
                out0 += flow
                out1 -= flow
        return out

    def pseudo_inverse(self) -> Float[np.ndarray, "n n"]:
        """Of the whole operator as a matrix, with a trace of the identity added."""
        n = self.inverse.size
        number = np.arange(n).reshape(self.inverse.shape)
        A = np.zeros((n, n))
        for c, i, j in self.edges(slice(None), number):
            A[i, j] = A[j, i] = -c
        A[range(n), range(n)] = -A.sum(1)
        A[range(n), range(n)] += 1e-6 * max(A.max(), 1e-30)
        return np.linalg.inv(A).astype(np.float32)


class Interpolation:
    """From every second row and column of a grid to all.

    west : (H, W - 1) share of the coarse pixel to the left in the pixel between it and the one to the right
    north : (H - 1, W) share of the coarse pixel above in the pixel between it and the one below
    corners : four (H - 1, W - 1), shares of the coarse pixels around in the pixel between all of them
    """

    def __init__(self, grid: Grid) -> None:
        E, S, D, U = grid.east, grid.south, grid.down, grid.up
        west, east, north, south = E[::2, ::2], E[::2, 1::2], S[::2, ::2], S[1::2, ::2]
        inverse = grid.inverse[1::2, 1::2]
        if D is not None and U is not None:  # the column to a pixel's left acts as one neighbour, as Dendy has it
            west, east, north, south = (c.copy() for c in (west, east, north, south))
            west[:-1] += U[::2, ::2]
            west[1:] += D[1::2, ::2]
            east[:-1] += D[::2, 1::2]
            east[1:] += U[1::2, 1::2]
            north[:, 1:] += D[::2, 1::2]
            north[:, :-1] += U[::2, ::2]
            south[:, 1:] += U[1::2, 1::2]
            south[:, :-1] += D[1::2, ::2]
        self.west, self.north = share(west, east), share(north, south)
        up, left, right, below = (c * inverse for c in (S[::2, 1::2], E[1::2, ::2], E[1::2, 1::2], S[1::2, 1::2]))
        self.corners = [
            up * self.west[:-1] + left * self.north[:, :-1],
            up * (1 - self.west[:-1]) + right * self.north[:, 1:],
            below * self.west[1:] + left * (1 - self.north[:, :-1]),
            below * (1 - self.west[1:]) + right * (1 - self.north[:, 1:]),
        ]
        if D is not None and U is not None:
            for shares, c in zip(self.corners, (D[::2, ::2], U[::2, 1::2], U[1::2, ::2], D[1::2, 1::2]), strict=True):
                shares += c * inverse

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

    def restricted(self, r: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "H W"]:
        """The adjoint of `prolonged`."""
        out = np.zeros((len(self.west) | 1, self.north.shape[1] | 1), np.float32)
        v = out[: len(self.west), : self.north.shape[1]]
        v += r[::2, ::2]
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
        return out

    def coarse(self, grid: Grid) -> Grid:
        """The grid of every second row and column whose energy is that of `grid` after interpolation."""
        E, S, D, U = grid.east, grid.south, grid.down, grid.up
        w, n = self.west, self.north
        top, bottom = (w[:-1], 1 - w[:-1], 0, 0), (0, 0, w[1:], 1 - w[1:])  # shares of the corners in what lies between
        left, right = (n[:, :-1], 0, 1 - n[:, :-1], 0), (0, n[:, 1:], 0, 1 - n[:, 1:])
        east = E[::2, ::2] * (1 - w) ** 2 + E[::2, 1::2] * w**2
        south = S[::2, ::2] * (1 - n) ** 2 + S[1::2, ::2] * n**2
        down = np.zeros(self.corners[0].shape, np.float32)
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

        middle = self.corners
        add(S[::2, 1::2], middle, top)
        add(S[1::2, 1::2], middle, bottom)
        add(E[1::2, ::2], middle, left)
        add(E[1::2, 1::2], middle, right)
        if D is not None and U is not None:
            for k, c in enumerate((D[::2, ::2], U[::2, 1::2], U[1::2, ::2], D[1::2, 1::2])):
                add(c, middle, [float(k == other) for other in range(4)])
            add(U[::2, ::2], top, left)
            add(D[::2, 1::2], top, right)
            add(D[1::2, ::2], bottom, left)
            add(U[1::2, 1::2], bottom, right)
        return Grid(east, south, down, up)


def share(a: Weights, b: Weights) -> Weights:
    """a / (a + b); a half where both are none."""
    total = a + b
    return np.divide(a, total, out=np.full_like(total, 0.5), where=total > TINY)


def padded(v: np.ndarray, h: int, w: int) -> np.ndarray:
    """(h, w), with zeros after its rows and columns where `v` has fewer; single precision."""
    if v.shape == (h, w):
        return v.astype(np.float32, copy=False)
    out = np.zeros((h, w), np.float32)
    out[: len(v), : v.shape[1]] = v
    return out
