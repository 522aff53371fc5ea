"""Values that were found at some rows and columns, and those between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

ROWS = 256  # of a map made at a time


def between(found: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"], step: int) -> Float[np.ndarray, "h w"]:
    """Positive values of all pixels of the mask from those of a grid: the nearest known one's, smoothed over it."""
    import cv2
    from scipy.ndimage import distance_transform_edt

    small = found[::step, ::step]
    nearest: Any = distance_transform_edt(np.isnan(small), return_distances=False, return_indices=True)
    logs = np.log(small[tuple(nearest)]).astype(np.float32)
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
