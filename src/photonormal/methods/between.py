"""Values that were found at some rows and columns, and those between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from photonormal.masked import box_of

ROWS = 256  # of a map made at a time


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
    for top in range(box[0].start, box[0].stop, ROWS):
        rows = slice(top, min(top + ROWS, box[0].stop))
        y, x = np.mgrid[rows, box[1]].astype(np.float32) / np.float32(step)
        first = top // step
        part = logs[first - above : rows.stop // step + 2 - above]  # between which these rows lie
        x, y = x - np.float32(left), y - np.float32(first)
        values = np.exp(cv2.remap(part, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        full[rows, box[1]] = np.where(mask[rows, box[1]], values, np.nan)
    return full
