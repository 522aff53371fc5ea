"""Small pictures of values, which notebooks show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from photonormal.png import encode_png

if TYPE_CHECKING:
    from photonormal.types import Capture, Normals, Surface

SIDE = 512  # pixels of the longer side, about
AT_MOST = 8  # photographs beside each other


def normals_png(normals: Normals) -> bytes:
    """(n + 1) / 2 in colours, white where there is none."""
    return encode_png(_small(_colours(normals)))


def surface_png(surface: Surface) -> bytes:
    """Near is bright; white where there is no depth."""
    z = np.where(surface.mask, surface.depth, np.nan) * (1 if surface.K is None else -1)
    known = z[np.isfinite(z)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    level = np.rint(230 * (z - low) / ((high - low) or 1))
    return encode_png(_small(np.nan_to_num(level, nan=255).astype(np.uint8)))


def capture_png(capture: Capture) -> bytes:
    """Some of the photographs, evenly picked, as a screen shows linear samples."""
    n = capture.images.shape[0]
    chosen = np.unique(np.linspace(0, n - 1, min(n, AT_MOST)).round().astype(int))
    pictures = [_small(capture.images[int(j)], SIDE // 2) for j in chosen]
    strip = np.concatenate(pictures, axis=1)
    white = max(float(np.quantile(strip, 0.995)), 1e-9)
    level = np.rint(255 * (strip / white).clip(0, 1) ** (1 / 2.2)).astype(np.uint8)
    return encode_png(np.broadcast_to(level, (*level.shape[:2], 3)))


def _colours(normals: Normals) -> np.ndarray:
    level = np.rint(127.5 * (normals.map + 1)).astype(np.uint8)
    level[~normals.mask] = 255
    return level


def _small(picture: np.ndarray, side: int = SIDE) -> np.ndarray:
    step = max(1, -(-max(picture.shape[:2]) // side))
    return picture[::step, ::step]
