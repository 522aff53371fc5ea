"""Weighted Laplacians on grids, and on some of their rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from photonormal.integration.bands import around, each_band

TINY = np.float32(1e-10)  # weights below are none: what rounding leaves between parts that do not touch

Weights = Float[np.ndarray, "_ _"]
FIRST, LAST, ALL = slice(None, -1), slice(1, None), slice(None)
ENDS = (  # of edges: to the right, down, right and down, right and up
    *(((ALL, FIRST), (ALL, LAST)), ((FIRST, ALL), (LAST, ALL))),
    *(((FIRST, FIRST), (LAST, LAST)), ((LAST, FIRST), (FIRST, LAST))),
)


class Grid(NamedTuple):
    """-div(c grad z) where every pixel has up to eight neighbours; odd numbers of rows and columns, or some rows.

    weights : of the edges (y, x) - (y, x + 1), (y, x) - (y + 1, x) and, but for the finest grid, which has none of
        these, (y, x) - (y + 1, x + 1) and (y + 1, x) - (y, x + 1)
    inverse : of the sum of a pixel's weights, each without its sign; 0 where it has none
    """

    weights: tuple[Weights, ...]
    inverse: Weights

    @classmethod
    def of(cls, east: Weights, south: Weights, *diagonals: Weights) -> Grid:
        h, w = len(east) | 1, south.shape[1] | 1
        straight = padded(east, h, w - 1), padded(south, h - 1, w)
        grid = cls((*straight, *(padded(c, h - 1, w - 1) for c in diagonals)), np.zeros((h, w), np.float32))

        def invert(rows: slice) -> None:
            part, own = around(rows, h)
            total = np.zeros_like(grid.inverse[part])
            for c, first, second in grid.part(part).edges(total):
                size = np.abs(c)
                first += size
                second += size
            np.divide(1, total[own], out=grid.inverse[rows], where=total[own] > TINY)

        each_band(invert, h, w)
        return grid

    def part(self, rows: slice) -> Grid:
        """Some rows and the edges between them."""
        east, *others = self.weights
        return Grid((east[rows], *(c[rows.start : rows.stop - 1] for c in others)), self.inverse[rows])

    def edges(self, *maps: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
        """Weights of the edges, of one kind after the other; each map at both of their ends."""
        for c, ends in zip(self.weights, ENDS, strict=False):
            yield c, *(v[end] for end in ends for v in maps)

    def flow(self, z: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
        """div(c grad z); without the edges to what lies around, where these are some rows."""
        out = np.zeros_like(z)
        for c, z0, out0, z1, out1 in self.edges(z, out):
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
        for c, i, j in self.edges(number):
            A[i, j] = A[j, i] = -c
        A[range(n), range(n)] = -A.sum(1)
        A[range(n), range(n)] += 1e-6 * max(A.max(), 1e-2)
        return np.linalg.inv(A).astype(np.float32)


def padded(v: np.ndarray, h: int, w: int, dtype: type = np.float32) -> np.ndarray:
    """(h, w), with zeros after its rows and columns where `v` has fewer."""
    if v.shape == (h, w):
        return v.astype(dtype, copy=False)
    out = np.zeros((h, w), dtype)
    out[: len(v), : v.shape[1]] = v
    return out
