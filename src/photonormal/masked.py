"""A mask's box and rim; values at its pixels and the maps that they lie on, a few rows at a time; smaller maps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Shaped

PIXELS = 2**20  # taken at a time
CLOSE = 16  # rows between two of a grid's up to which all of them are read: faster than each by itself


def row_bands(mask: Bool[np.ndarray, "h w"], pixels: int = PIXELS) -> list[slice]:
    """Rows that the mask reaches, each part with at most so many pixels on the mask, or one row."""
    parts, first, held = [], 0, 0
    for y, count in enumerate([*np.count_nonzero(mask, axis=1).tolist(), 0]):
        if held and (held + count > pixels or not count):
            parts.append(slice(first, y))
            held = 0
        first = first if held else y
        held += count
    return parts


def grid_bands(mask: Bool[np.ndarray, "h w"], pixels: int = PIXELS) -> list[slice]:
    """The same of a mask that may reach every second or third row only: those between are skipped."""
    lines = np.flatnonzero(mask.any(1))
    first, step = (int(lines[0]) if lines.size else 0), int(np.gcd.reduce(np.diff(lines), initial=0))
    step = step if 0 < step <= CLOSE else 1
    parts = row_bands(mask[first::step], pixels)
    return [slice(first + step * part.start, first + step * (part.stop - 1) + 1, step) for part in parts]


def numbered(mask: Bool[np.ndarray, "h w"]) -> Iterator[tuple[slice, slice]]:
    """Some rows after the other, and which of the mask's pixels lie there."""
    first = 0
    for rows in row_bands(mask):
        last = first + int(np.count_nonzero(mask[rows]))
        yield rows, slice(first, last)
        first = last


def picked(map: Shaped[np.ndarray, "h w ..."], mask: Bool[np.ndarray, "h w"]) -> Shaped[np.ndarray, "p ..."]:
    """The values of a map, or a part of one, at the mask's pixels: `map[mask]`, several times as fast."""
    return map.reshape(mask.size, *map.shape[2:]).take(np.flatnonzero(mask), axis=0)


def taken(map: Shaped[np.ndarray, "h w ..."], mask: Bool[np.ndarray, "h w"]) -> Shaped[np.ndarray, "p ..."]:
    """The values at the mask's pixels."""
    values = np.empty((np.count_nonzero(mask), *map.shape[2:]), map.dtype)
    for rows, pixels in numbered(mask):
        values[pixels] = picked(map[rows], mask[rows])
    return values


def on_map(
    values: Shaped[np.ndarray, "p ..."], mask: Bool[np.ndarray, "h w"], outside: float = 0
) -> Shaped[np.ndarray, "h w ..."]:
    """A map, float32, with these values at the mask's pixels."""
    map = np.full((*mask.shape, *values.shape[1:]), outside, np.float32)
    for rows, pixels in numbered(mask):
        map[rows][mask[rows]] = values[pixels]
    return map


def means(map: Shaped[np.ndarray, "h w ..."], step: int) -> Shaped[np.ndarray, "rows columns ..."]:
    """Over squares of `step` pixels a side; at the lower and right edge what there is of them counts again."""
    if step == 1:
        return map
    h, w = map.shape[:2]
    padded = np.pad(map, ((0, -h % step), (0, -w % step), *[(0, 0)] * (map.ndim - 2)), mode="edge")
    return padded.reshape(-(-h // step), step, -(-w // step), step, *map.shape[2:]).mean((1, 3))


def made_smaller(picture: Shaped[np.ndarray, "h w ..."], scale: float) -> Shaped[np.ndarray, "i j ..."]:
    """By a factor, of means over areas; no less than a pixel a side is left. Itself where the factor is not below 1."""
    import cv2

    if scale >= 1:
        return picture
    h, w = (max(1, round(scale * side)) for side in picture.shape[:2])
    size = (w, h) if 1 in (h, w) else None  # else OpenCV's own, by the factor alone
    return np.asarray(cv2.resize(picture, size, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))


def box_of(mask: Bool[np.ndarray, "h w"], margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns of the smallest box around the mask, grown by `margin` pixels within the frame; of an empty
    mask, the frame."""
    spans = []
    for axis, size in zip((1, 0), mask.shape, strict=True):
        inside = np.flatnonzero(mask.any(axis))
        first, last = (int(inside[0]), int(inside[-1])) if inside.size else (0, size - 1)
        spans.append(slice(max(0, first - margin), min(size, last + 1 + margin)))
    return spans[0], spans[1]


def thinned(mask: Bool[np.ndarray, "h w"], step: int) -> Bool[np.ndarray, "h w"]:
    """One of `step` of the mask's pixels."""
    found = mask.copy()
    found.flat[np.delete(np.flatnonzero(mask), slice(None, None, step))] = False
    return found


def on_rim(mask: Bool[np.ndarray, "h w"]) -> float:
    """Part of the frame's outermost pixels that is on a mask."""
    edge = np.ones_like(mask)
    edge[1:-1, 1:-1] = False
    return float(mask[edge].mean())
