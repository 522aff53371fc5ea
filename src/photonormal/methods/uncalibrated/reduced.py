"""A whole object as a small square, as a network that tells lights reads it."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.types import Capture, box_of

AROUND = 1.1  # side of the square over the longer side of the object


def reduced(capture: Capture, side: int) -> tuple[Float[Tensor, "n c s s"], Bool[Tensor, "s s"]]:
    """All images of the object in a square of `side` pixels, zero outside the mask, which is given beside them.

    The object is in the square's middle; linear radiance is averaged over the part of a pixel's area on the mask.
    """
    import cv2

    rows, columns = box_of(capture.mask)
    mask = capture.mask[rows, columns]
    h, w = mask.shape
    edge = int(np.ceil(AROUND * max(h, w)))
    top, left = (edge - h) // 2, (edge - w) // 2

    def small(map: Float[np.ndarray, "h w c"]) -> Float[np.ndarray, "s s c"]:
        square = np.zeros((edge, edge, map.shape[2]), np.float32)
        square[top : top + h, left : left + w] = map
        return cv2.resize(square, (side, side), interpolation=cv2.INTER_AREA).reshape(side, side, -1)

    share = small(mask[..., None].astype(np.float32))  # (s, s, 1)
    inside = share[..., 0] > 0.5

    def read(j: int) -> Float[np.ndarray, "c s s"]:
        image = np.nan_to_num(capture.window(j, rows, columns), nan=0, posinf=0, neginf=0)
        found = small(image * mask[..., None]) / np.maximum(share, 0.5) * inside[..., None]
        return np.ascontiguousarray(found.transpose(2, 0, 1))

    return torch.from_numpy(np.stack(capture.each_image(read))), torch.from_numpy(inside)
