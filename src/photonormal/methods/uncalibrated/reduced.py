"""A whole object as a small square, as a network that finds lights reads it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.masked import box_of
from photonormal.types import Capture

AROUND = 1.1  # side of the square over the longer side of the object
DETAIL = 8  # pixels of a picture, along a side, that become one of the square at most
PIXELS = 2**17  # of a picture, read at a time: they fit into a cache


def reduced(capture: Capture, side: int) -> tuple[Float[Tensor, "n c s s"], Bool[Tensor, "s s"]]:
    """All images of the object in a square of `side` pixels, zero outside the mask, which is given beside them.

    The object is in the square's middle; linear radiance is averaged over the part of a pixel's area on the mask. Large
    pictures are read some rows at a time, and every few rows and columns become one first.
    """
    import cv2

    rows, columns = box_of(capture.mask)
    step = max(1, max(rows.stop - rows.start, columns.stop - columns.start) // (DETAIL * side))
    h, w = (max(1, (span.stop - span.start) // step) for span in (rows, columns))
    edge = int(np.ceil(AROUND * max(h, w)))
    top, left = (edge - h) // 2, (edge - w) // 2
    columns = slice(columns.start, columns.start + w * step)
    high = max(1, PIXELS // (w * step**2))
    bands = [(y, min(y + high, h)) for y in range(0, h, high)]

    def small(part: Callable[[slice], Float[np.ndarray, "k l c"]], channels: int) -> Float[np.ndarray, "s s c"]:
        square = np.zeros((edge, edge, channels), np.float32)
        for first, last in bands:
            found = part(slice(rows.start + first * step, rows.start + last * step))
            found = cv2.resize(found, (w, last - first), interpolation=cv2.INTER_AREA)
            square[top + first : top + last, left : left + w] = found.reshape(last - first, w, channels)
        return cv2.resize(square, (side, side), interpolation=cv2.INTER_AREA).reshape(side, side, -1)

    share = small(lambda band: capture.mask[band, columns, None].astype(np.float32), 1)  # (s, s, 1)
    inside = share[..., 0] > 0.5

    def read(j: int) -> Float[np.ndarray, "c s s"]:
        def on_object(band: slice) -> Float[np.ndarray, "k l c"]:
            image = capture.window(j, band, columns)
            return np.where(np.isfinite(image) & capture.mask[band, columns, None], image, np.float32(0))

        found = small(on_object, capture.images.shape[3]) / np.maximum(share, 0.5) * inside[..., None]
        return np.ascontiguousarray(found.transpose(2, 0, 1))

    return torch.from_numpy(np.stack(capture.each_image(read))), torch.from_numpy(inside)
