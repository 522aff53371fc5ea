"""Values that were found at some rows and columns, and those between them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from photonormal.masked import box_of

ROWS, COLUMNS = 256, 2**14  # of a map made at a time; OpenCV maps fewer than 2**15


def everywhere(map: Float[np.ndarray, "h w *c"], known: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w *c"]:
    """A map that has, where nothing is known, what the nearest known place has."""
    from scipy.ndimage import distance_transform_edt

    nearest: Any = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return map[tuple(nearest)]


def between(grid: Float[np.ndarray, "a b"], mask: Bool[np.ndarray, "h w"], step: int) -> Float[np.ndarray, "h w"]:
    """Positive values of all pixels of the mask from those at every `step`-th row and column, NaN where unknown.

    The nearest known one's, smoothed over the grid.
    """
    import cv2

    box = box_of(mask)
    above, left = (side.start // step for side in box)
    small = grid[above : -(-box[0].stop // step) + 1, left : -(-box[1].stop // step) + 1]
    logs = np.log(everywhere(small, ~np.isnan(small))).astype(np.float32)
    full = np.full(mask.shape, np.nan, np.float32)
    for rows, columns in tiles(*box):
        y, x = np.mgrid[rows, columns].astype(np.float32) / np.float32(step)
        (first_y, near_y), (first_x, near_x) = (
            _between_which(s, step, at) for s, at in ((rows, above), (columns, left))
        )
        x, y = x - np.float32(first_x), y - np.float32(first_y)
        part = logs[near_y, near_x]
        values = np.exp(cv2.remap(part, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        full[rows, columns] = np.where(mask[rows, columns], values, np.nan)
    return full


def tiles(rows: slice, columns: slice) -> Iterator[tuple[slice, slice]]:
    """Parts of a map, of ROWS rows and COLUMNS columns at most."""
    for top in range(rows.start, rows.stop, ROWS):
        for left in range(columns.start, columns.stop, COLUMNS):
            yield slice(top, min(top + ROWS, rows.stop)), slice(left, min(left + COLUMNS, columns.stop))


def _between_which(part: slice, step: int, first: int) -> tuple[int, slice]:
    """The grid's first row, or column, at some of a map's, and those between which they lie, counted from `first`."""
    return part.start // step, slice(part.start // step - first, part.stop // step + 2 - first)
