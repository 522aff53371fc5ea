"""Depth as triangle meshes: vertices, triangles, colours, and how many there are at most."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.srgb import from_linear
from photonormal.types import Surface

FACES = 2_000_000  # triangles of a mesh at most, unless said


def vertices(surface: Surface, step: int = 1) -> Float[np.ndarray, "v 3"]:
    """Positions of the mask's pixels in every `step`-th row and column, row by row: x right, y up, z to the camera.

    Orthographic: in pixels from the picture's lower left corner. Perspective: in the depth's unit from the camera.
    """
    row, column = step * np.array(np.nonzero(surface.mask[::step, ::step]))
    return positions(row, column, surface.depth[row, column], surface.mask.shape[0], surface.K)


def positions(
    row: Int[np.ndarray, " v"],
    column: Int[np.ndarray, " v"],
    depth: Float[np.ndarray, " v"],
    height: int,
    K: np.ndarray | None,
) -> Float[np.ndarray, "v 3"]:
    """The same of some pixels of a picture of `height` rows."""
    depth = depth.astype(np.float64)
    if K is None:
        return np.stack([column + 0.5, height - row - 0.5, depth], axis=-1)
    ray = np.linalg.solve(K, np.stack([column, row, np.ones_like(row)]).astype(np.float64))  # x right, y down
    return (ray / ray[2] * depth * np.array([[1], [-1], [-1]])).T


def faces(mask: np.ndarray) -> Int[np.ndarray, "f 3"]:
    """Triangles between neighbouring pixels of the mask, facing the camera; indices of `vertices`."""
    index = np.full(mask.shape, -1, np.int64)
    index[mask] = np.arange(mask.sum())
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]  # upper left, upper right, lower ...
    triangles = []
    full = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    for corner, keep in (((a, c, b), full), ((b, c, d), full)):
        triangles.append(np.stack([k[keep] for k in corner], axis=-1))
    for missing, corner in ((a, (b, c, d)), (b, (a, c, d)), (c, (a, d, b)), (d, (a, c, b))):
        keep = (missing < 0) & (corner[0] >= 0) & (corner[1] >= 0) & (corner[2] >= 0)
        triangles.append(np.stack([k[keep] for k in corner], axis=-1))
    return np.concatenate(triangles)


def step_for(mask: Bool[np.ndarray, "h w"], most_faces: int) -> int:
    """Rows and columns between the vertices of a mesh of about `most_faces` triangles at most."""
    return max(1, int(np.ceil(np.sqrt(2 * np.count_nonzero(mask) / most_faces))))


def scale_of(surface: Surface, mm_per_px: float | None) -> float:
    """What a depth's unit is in millimetres, where a pixel is `mm_per_px` wide at the mean depth; 1 without that."""
    if mm_per_px is None:
        return 1.0
    return mm_per_px if surface.K is None else float(surface.K[0, 0]) * mm_per_px


def coordinates(mask: np.ndarray, step: int) -> Float[np.ndarray, "v 2"]:
    """Places of the pixels of `vertices` in the picture: x to the right, y up, both from 0 to 1."""
    row, column = step * np.array(np.nonzero(mask[::step, ::step]))
    h, w = mask.shape
    return np.stack([(column + 0.5) / w, 1 - (row + 0.5) / h], axis=-1)


def display(linear: np.ndarray, full: int = 255) -> np.ndarray:
    """8-bit sRGB from linear values, or 16-bit for a `full` scale of 65535; what is above 1 is white."""
    x = np.nan_to_num(linear).clip(0, 1)
    return np.rint(full * from_linear(x)).astype(np.uint8 if full < 256 else np.uint16)
