"""Pictures of numbers for the page: every quantity of a pixel as small integers, at every size, cut into tiles.

A tile is SIDE x SIDE pixels and one more on every side, so that what is drawn between pixels has no seams. Colours are
WebP; what is measured is kept exactly: differences along the row, low bytes before high ones, deflated.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

SIDE = 512  # pixels of a tile
UNIT = 4095  # of a normal's components
LEVELS_PER_DEGREE = 4  # of an 8-bit angle
UNKNOWN = 255  # the level where there is no angle
QUALITY = 92  # of WebP


@dataclass(frozen=True)
class Plane:
    """One quantity of every pixel.

    Parameters
    ----------
    kind : "normals", int16 (h, w, 3), UNIT times the vector, zero where there is none; "height", uint16 (h, w, 1), zero
        where there is none; "degrees", uint8 (h, w, 1), UNKNOWN where there is none; "colour", uint8 (h, w, 3), sRGB
    levels : the whole at full size, at half, at a quarter, ... down to one tile
    """

    kind: str
    levels: tuple[np.ndarray, ...]

    def tile(self, level: int, x: int, y: int) -> bytes:
        """The tile in column x and row y of a level; IndexError where there is none."""
        if not (0 <= level < len(self.levels) and x >= 0 and y >= 0):
            raise IndexError
        whole = self.levels[level]
        h, w = whole.shape[:2]
        if x * SIDE >= w or y * SIDE >= h:
            raise IndexError
        rows = np.arange(y * SIDE - 1, min((y + 1) * SIDE, h) + 1).clip(0, h - 1)
        columns = np.arange(x * SIDE - 1, min((x + 1) * SIDE, w) + 1).clip(0, w - 1)
        part = whole[rows[0] : rows[-1] + 1][rows - rows[0]][:, columns]
        return as_webp(part) if self.kind == "colour" else exact(part)


def plane(kind: str, whole: np.ndarray) -> Plane:
    """A quantity at every size."""
    levels = [whole]
    while max(levels[-1].shape[:2]) > SIDE:
        levels.append(HALVED[kind](levels[-1]))
    return Plane(kind, tuple(levels))


def normals_plane(map: np.ndarray) -> Plane:
    """Unit vectors (h, w, 3), zero where there is none."""
    whole = np.empty(map.shape, np.int16)
    for y in range(0, len(map), SIDE):  # large ones would not fit several times
        whole[y : y + SIDE] = np.rint(UNIT * map[y : y + SIDE])
    return plane("normals", whole)


def height_plane(height: np.ndarray) -> tuple[Plane, float, float]:
    """Heights (h, w), NaN where there is none: the plane, the height of level 1, and of a step."""
    known = np.isfinite(height)
    low, high = (float(height[known].min()), float(height[known].max())) if known.any() else (0.0, 0.0)
    step = max(high - low, 1e-9) / 65534
    level = np.zeros(height.shape, np.uint16)
    level[known] = np.rint(1 + (height[known] - low) / step).clip(1, 65535)
    return plane("height", level[..., None]), low, step


def degrees_plane(angle: np.ndarray) -> Plane:
    """Angles (h, w) in degrees, NaN where there is none; more than 63.5 count as that."""
    known = np.isfinite(angle)
    level = np.full(angle.shape, UNKNOWN, np.uint8)
    level[known] = np.rint(LEVELS_PER_DEGREE * angle[known]).clip(0, UNKNOWN - 1)
    return plane("degrees", level[..., None])


def units() -> dict[str, int]:
    """What the page has to know of the planes' integers."""
    return {"unit": UNIT, "levels_per_degree": LEVELS_PER_DEGREE, "unknown": UNKNOWN}


def exact(part: np.ndarray) -> bytes:
    """Integers (h, w, c), deflated without loss."""
    h, w, c = part.shape
    change = np.diff(part, axis=1, prepend=np.zeros((h, 1, c), part.dtype))  # wraps around, and so does the sum
    little = np.ascontiguousarray(change.astype(part.dtype.newbyteorder("<")))
    return zlib.compress(little.view(np.uint8).reshape(h, w, c, -1).transpose(3, 2, 0, 1).tobytes(), 3)


def as_webp(part: np.ndarray) -> bytes:
    """A picture (h, w, 3) as WebP."""
    import cv2

    bgr = np.ascontiguousarray(part[..., ::-1])
    return cv2.imencode(".webp", bgr, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes()


def _fours(whole: np.ndarray) -> list[np.ndarray]:
    """The four pixels that become one, (h / 2, w / 2, c) each; an odd last row or column counts twice."""
    h, w = whole.shape[:2]
    even = np.pad(whole, ((0, h % 2), (0, w % 2), (0, 0)), mode="edge") if h % 2 or w % 2 else whole
    return [even[a::2, b::2].astype(np.int32) for a in (0, 1) for b in (0, 1)]


def _mean_where(known: Callable[[np.ndarray], np.ndarray], missing: int) -> Callable[[np.ndarray], np.ndarray]:
    """The mean of those that are known, where at least two are."""

    def halved(whole: np.ndarray) -> np.ndarray:
        total, count = 0, 0
        for part in _fours(whole):
            there = known(part)
            total, count = total + part * there, count + there.astype(np.int32)
        return np.where(count >= 2, total / np.maximum(count, 1) + 0.5, missing).astype(whole.dtype)

    return halved


def _mean_direction(whole: np.ndarray) -> np.ndarray:
    fours = _fours(whole)
    total = np.sum(fours, axis=0).astype(np.float32)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    count = np.sum([part.any(-1, keepdims=True) for part in fours], axis=0)
    return np.where(count >= 2, np.rint(UNIT * total / np.maximum(length, 1)), 0).astype(np.int16)


def _mean_colour(whole: np.ndarray) -> np.ndarray:
    return ((np.sum(_fours(whole), axis=0) + 2) // 4).astype(np.uint8)


HALVED = {
    "normals": _mean_direction,
    "height": _mean_where(lambda v: v > 0, 0),
    "degrees": _mean_where(lambda v: v < UNKNOWN, UNKNOWN),
    "colour": _mean_colour,
}
