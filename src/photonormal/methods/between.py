"""Values that were found at some rows and columns, and those between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

ROWS = 256  # of a map made at a time


def everywhere(map: Float[np.ndarray, "h w *c"], known: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w *c"]:
    """A map that has, where nothing is known, what the nearest known place has."""
    from scipy.ndimage import distance_transform_edt

    nearest: Any = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return map[tuple(nearest)]


def between(found: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"], step: int) -> Float[np.ndarray, "h w"]:
    """Positive values of all pixels of the mask from those of a grid: the nearest known one's, smoothed over it."""
    import cv2

    small = found[::step, ::step]
    logs = np.log(everywhere(small, ~np.isnan(small))).astype(np.float32)
    h, w = mask.shape
    full = np.empty(mask.shape, np.float32)
    for top in range(0, h, ROWS):
        rows = slice(top, min(top + ROWS, h))
        y, x = np.mgrid[rows, :w].astype(np.float32) / np.float32(step)
        first = top // step
        part = logs[first : rows.stop // step + 2]  # between which these rows lie
        full[rows] = cv2.remap(part, x, y - np.float32(first), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    np.exp(full, out=full)
    full[~mask] = np.nan
    return full
