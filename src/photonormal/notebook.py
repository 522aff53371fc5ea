"""Small pictures of values, which notebooks show."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from photonormal.png import encode_png

SIDE = 512  # pixels of the longer side, about
AT_MOST = 8  # photographs beside each other


def normals_png(normals: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> bytes:
    """(n + 1) / 2 in colours, white where there is none."""
    level = np.rint(127.5 * (normals + 1)).astype(np.uint8)
    level[~mask] = 255
    return encode_png(_small(level))


def surface_png(heights: Float[np.ndarray, "h w"]) -> bytes:
    """High is bright; white where there is no height."""
    known = heights[np.isfinite(heights)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    level = np.rint(230 * (heights - low) / ((high - low) or 1))
    return encode_png(_small(np.nan_to_num(level, nan=255).astype(np.uint8)))


def capture_png(images: Any) -> bytes:
    """Some of the photographs, (n, h, w, c) or what decodes them, evenly picked, as a screen shows linear samples."""
    n = images.shape[0]
    chosen = np.unique(np.linspace(0, n - 1, min(n, AT_MOST)).round().astype(int))
    pictures = [_small(images[int(j)], SIDE // 2) for j in chosen]
    strip = np.concatenate(pictures, axis=1)
    white = max(float(np.quantile(strip, 0.995)), 1e-9)
    level = np.rint(255 * (strip / white).clip(0, 1) ** (1 / 2.2)).astype(np.uint8)
    return encode_png(np.broadcast_to(level, (*level.shape[:2], 3)))


def _small(picture: np.ndarray, side: int = SIDE) -> np.ndarray:
    step = max(1, -(-max(picture.shape[:2]) // side))
    return picture[::step, ::step]
