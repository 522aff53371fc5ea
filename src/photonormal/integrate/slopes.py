"""What normals say about slopes, in both views, and the surface that a solution becomes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import label

from photonormal.types import InputError, Normals, Surface


@dataclass(frozen=True)
class Slopes:
    """The equations a dz/dx = b[0], a dz/dy = b[1] at every pixel of the mask; x and y are counted right and *down*.

    The unknown z is in pixels: the height towards the camera (orthographic), or f ln(distance) (perspective). In both,
    `a` is the cosine between the normal and the viewing ray (times the ray's length, nearly 1).

    Parameters
    ----------
    mask : (h, w), the bounding rectangle of the normals' mask
    a : (h, w), at least `grazing`; b : (2, h, w); both zero outside the mask
    f : pixels for one unit of ln(distance); 1 in an orthographic view
    """

    mask: Bool[np.ndarray, "h w"]
    a: Float[np.ndarray, "h w"]
    b: Float[np.ndarray, "2 h w"]
    f: float

    def along_edges(self) -> tuple[Float[np.ndarray, "h w1"], Float[np.ndarray, "h1 w"]]:
        """z steps from each pixel to its right and to its lower neighbour: (b_i + b_j) / (a_i + a_j).

        On a plane and on a sphere the mean of two unit normals is perpendicular to the chord between their points, so
        that this is exact on both in an orthographic view; elsewhere it is of second order. Zero where a neighbour is
        off the mask.
        """
        a, (bx, by) = self.a, self.b
        right, down = pairs(self.mask)
        gx = np.divide(bx[:, :-1] + bx[:, 1:], a[:, :-1] + a[:, 1:], out=np.zeros(right.shape), where=right)
        gy = np.divide(by[:-1] + by[1:], a[:-1] + a[1:], out=np.zeros(down.shape), where=down)
        return gx, gy


def slopes(normals: Normals, K: np.ndarray | None, grazing: float) -> Slopes:
    """The slope equations of `normals` in the view of camera matrix `K` (None: orthographic).

    `grazing` in (0, 1) is the least cosine between a normal and its viewing ray: normals that look further aside, or
    away from the camera, count as if they had it, so that no step is much above 1/grazing pixels.
    """
    if not 0 < grazing < 1:
        raise InputError(f"grazing is {grazing} but a cosine between 0 and 1 is needed; 0.05 is usual.")
    rows, columns = np.flatnonzero(normals.mask.any(1)), np.flatnonzero(normals.mask.any(0))
    y0, x0 = rows[0], columns[0]
    box = slice(y0, rows[-1] + 1), slice(x0, columns[-1] + 1)
    mask, n = normals.mask[box], np.moveaxis(normals.map[box], 2, 0).astype(np.float64, order="C")  # (3, h, w)
    if K is None:
        # n . (dx, -dy, dz) = 0 on the tangent plane, y of the picture running against y of the frame
        a, bx, by, f = n[2], -n[0], n[1], 1.0
    else:
        f = float(K[0, 0])
        flip = np.diag([1.0, -1.0, -1.0])  # camera axes (right, down, forward) to the frame (right, up, towards)
        R = flip @ np.linalg.inv(K)  # a point is P = d r, r = R (x, y, 1), d the distance along the axis
        # n . dP = 0 with P = exp(z / f) r:  (-n . r) dz/dx = f n . dr/dx
        rx, ry, r0 = np.tensordot(R, n, axes=(0, 0))  # (3, h, w): n . R
        x, y = x0 + np.arange(mask.shape[1]), y0 + np.arange(mask.shape[0])[:, None]
        a = -(rx * x + ry * y + r0)
        bx, by = f * rx, f * ry
    return Slopes(mask, np.where(mask, np.maximum(a, grazing), 0), np.stack([bx, by]), f)


def steps(
    b: Float[np.ndarray, "h w"], a: Float[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"], axis: int
) -> Float[np.ndarray, "h w"]:
    """As `Slopes.along_edges`, along one axis of a picture whose edges meet; zero where not `known`."""
    total = a + np.roll(a, -1, axis)
    return np.divide(b + np.roll(b, -1, axis), total, out=np.zeros(a.shape), where=known)


def pairs(mask: Bool[np.ndarray, "h w"]) -> tuple[Bool[np.ndarray, "h w1"], Bool[np.ndarray, "h1 w"]]:
    """Where a pixel and its right neighbour, and where a pixel and its lower neighbour, are both on the mask."""
    return mask[:, :-1] & mask[:, 1:], mask[:-1] & mask[1:]


def surface(z: Float[np.ndarray, " p"], normals: Normals, K: np.ndarray | None, f: float) -> Surface:
    """The surface of z at the `p` pixels of the mask, with the free constant (scale) of each connected part fixed."""
    mask = normals.mask
    parts = np.zeros(mask.shape, np.int32)
    label(mask, output=parts)
    part = parts[mask]  # (p,), from 1
    size = np.maximum(np.bincount(part), 1)
    z = z - (np.bincount(part, z) / size)[part]
    if K is not None:
        z = np.exp(z / f)
        z = z / (np.bincount(part, z) / size)[part]
    depth = np.full(mask.shape, np.nan)
    depth[mask] = z
    return Surface(depth, mask, K)
