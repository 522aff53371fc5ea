"""What normals say about slopes, in both views, and the surface that a solution becomes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import label

from photonormal.integration.bands import around, each_band
from photonormal.masked import box_of
from photonormal.types import InputError, Normals, Surface

ROWS = 128  # computed at a time, to bound the memory


@dataclass(frozen=True)
class Slopes:
    """The equations a dz/dx = b[0], a dz/dy = b[1] at every pixel of the mask; x and y are counted right and *down*.

    The unknown z is in pixels: the height towards the camera (orthographic), or f ln(distance) (perspective). In both,
    `a` is the cosine between the normal and the viewing ray (times the ray's length, nearly 1).

    Parameters
    ----------
    normals : the surface's
    K : (3, 3) camera matrix of a perspective view; None: orthographic
    grazing : in (0, 1), least cosine between a normal and its viewing ray: normals that look further aside, or away
        from the camera, count as if they had it, so that no step is much above 1/grazing pixels
    """

    normals: Normals
    K: np.ndarray | None
    grazing: float

    def __post_init__(self) -> None:
        if not 0 < self.grazing < 1:
            raise InputError(f"grazing is {self.grazing} but a cosine between 0 and 1 is needed; 0.05 is usual.")

    @property
    def box(self) -> tuple[slice, slice]:
        """The mask's bounding rectangle, to which all arrays belong."""
        return box_of(self.normals.mask)

    @property
    def mask(self) -> Bool[np.ndarray, "h w"]:
        """The mask in the box."""
        return self.normals.mask[self.box]

    @property
    def f(self) -> float:
        """Pixels for one unit of ln(distance); 1 in an orthographic view."""
        return 1.0 if self.K is None else float(self.K[0, 0])

    def rows(self, first: int, last: int) -> tuple[Float[np.ndarray, "k w"], Float[np.ndarray, "2 k w"]]:
        """a, at least `grazing`, and b, of some rows of the box; `a` is zero outside the mask."""
        top, left = (span.start for span in self.box)
        rows = slice(top + first, top + last)
        mask = self.normals.mask[rows, self.box[1]]
        n = np.moveaxis(self.normals.map[rows, self.box[1]], 2, 0).astype(np.float64, order="C")  # (3, k, w)
        if self.K is None:
            # n . (dx, -dy, dz) = 0 on the tangent plane, y of the picture running against y of the frame
            a, b = n[2], np.stack([-n[0], n[1]])
        else:
            flip = np.diag([1.0, -1.0, -1.0])  # camera axes (right, down, forward) to the frame (right, up, towards)
            R = flip @ np.linalg.inv(self.K)  # a point is P = d r, r = R (x, y, 1), d the distance along the axis
            # n . dP = 0 with P = exp(z / f) r:  (-n . r) dz/dx = f n . dr/dx
            rx, ry, r0 = np.tensordot(R, n, axes=(0, 0))  # (3, k, w): n . R
            x, y = left + np.arange(mask.shape[1]), rows.start + np.arange(mask.shape[0])[:, None]
            a, b = -(rx * x + ry * y + r0), self.f * np.stack([rx, ry])
        return np.where(mask, np.maximum(a, self.grazing), 0), b

    def along_edges(self) -> Iterator[tuple[int, Float[np.ndarray, "k w1"], Float[np.ndarray, "k1 w"]]]:
        """First row, and z steps from each pixel to its right and to its lower neighbour, of some rows after the other.

        They are (b_i + b_j) / (a_i + a_j). On a plane and on a sphere the mean of two unit normals is perpendicular to
        the chord between their points, so that this is exact on both in an orthographic view; elsewhere it is of second
        order. Zero where a neighbour is off the mask.
        """
        mask = self.mask
        for y in range(0, len(mask), ROWS):
            own = min(ROWS, len(mask) - y)
            a, (bx, by) = self.rows(y, min(y + ROWS + 1, len(mask)))  # one more, for the steps down to it
            right, down = adjacent(mask[y : y + len(a)])
            a_x, b_x = (v[:own, :-1] + v[:own, 1:] for v in (a, bx))
            yield (
                y,
                np.divide(b_x, a_x, out=np.zeros_like(b_x), where=right[:own]),
                np.divide(by[:-1] + by[1:], a[:-1] + a[1:], out=np.zeros(down.shape), where=down),
            )

    def divergence(self) -> Float[np.ndarray, "h w"]:
        """What the steps along the edges carry out of each pixel."""
        f = np.zeros(self.mask.shape)
        for y, gx, gy in self.along_edges():
            add_divergence(f[y : y + len(gx) + 1], gx, gy)
        return f


def add_divergence(f: Float[np.ndarray, "h w"], gx: Float[np.ndarray, "k w1"], gy: Float[np.ndarray, "l w"]) -> None:
    """Add what flows out of each pixel along its edges, of the first rows; minus the adjoint of `np.diff`."""
    f[: len(gx), :-1] += gx
    f[: len(gx), 1:] -= gx
    f[: len(gy)] += gy
    f[1 : len(gy) + 1] -= gy


def weighted_laplacian(z: Float[np.ndarray, "h w"], cx: np.ndarray, cy: np.ndarray, rows: slice) -> np.ndarray:
    """Some rows of -div(c grad z): weights cx (h, w - 1) of the edges to the right and cy (h - 1, w) of those down."""
    part, own = around(rows, len(z))
    z = z[part]
    found = np.zeros_like(z)
    add_divergence(found, cx[part] * (z[:, :-1] - z[:, 1:]), cy[part.start : part.stop - 1] * (z[:-1] - z[1:]))
    return found[own]


def steps(
    b: Float[np.ndarray, "h w"], a: Float[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"], axis: int
) -> Float[np.ndarray, "h w"]:
    """As `Slopes.along_edges`, along one axis of a picture whose edges meet; zero where not `known`."""
    total = a + np.roll(a, -1, axis)
    return np.divide(b + np.roll(b, -1, axis), total, out=np.zeros(a.shape), where=known)


def adjacent(mask: Bool[np.ndarray, "h w"]) -> tuple[Bool[np.ndarray, "h w1"], Bool[np.ndarray, "h1 w"]]:
    """Where a pixel and its right neighbour, and where a pixel and its lower neighbour, are both on the mask."""
    return mask[:, :-1] & mask[:, 1:], mask[:-1] & mask[1:]


def part_means(parts: Int[np.ndarray, "h w"], values: Callable[[slice], np.ndarray]) -> Float[np.ndarray, " parts"]:
    """The mean of the values of some rows over each numbered part, of which there may be as many as pixels."""
    count = int(parts.max()) + 1
    total, size = np.zeros((2, count))
    for y in range(0, len(parts), ROWS):
        rows = slice(y, min(y + ROWS, len(parts)))
        numbers = parts[rows].ravel()
        total += np.bincount(numbers, values(rows).ravel(), count)
        size += np.bincount(numbers, minlength=count)
    return total / np.maximum(size, 1)


def surface(z: Float[np.ndarray, "h w"], slopes: Slopes) -> Surface:
    """The surface of z in the mask's box, which is written over, with the free constant (scale) of each part fixed."""
    mask, f = slopes.mask, slopes.f
    parts = np.zeros(mask.shape, np.int32)
    label(mask, output=parts)  # from 1; 0 is outside
    middle, scale = part_means(parts, lambda y: z[y]), np.ones(1)
    if slopes.K is not None:
        scale = part_means(parts, lambda y: np.exp((z[y] - middle[parts[y]]) / f))
    depth = np.full(slopes.normals.mask.shape, np.nan, np.float32)
    inside = depth[slopes.box]

    def fixed(y: slice) -> None:
        of = parts[y]
        found = z[y] - middle[of]
        if slopes.K is not None:
            found = np.exp(found / f) / scale[of]
        np.copyto(inside[y], found, where=of > 0, casting="same_kind")

    each_band(fixed, *mask.shape)
    return Surface(depth, slopes.normals.mask, slopes.K)
