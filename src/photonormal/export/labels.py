"""Words and scales on pictures for people."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import UInt8

from photonormal.scoring import SCALE_DEG, colours

Rows = tuple[Callable[[slice], np.ndarray], tuple[int, int]]
INK = (40, 40, 40)
LARGEST = 0.5  # of letters, in OpenCV's unit: about 12 pixels high
NARROWEST = 200  # pixels that a scale takes
TICKS = 4  # numbers on a scale


def labelled(picture: UInt8[np.ndarray, "h w 3"], text: str) -> UInt8[np.ndarray, "h2 w 3"]:
    """The picture under its name, in letters that fit its width."""
    bar = np.full((20, picture.shape[1], 3), 255, np.uint8)
    _write(bar, text, 2, 14, LARGEST, picture.shape[1] - 4)
    return np.concatenate([bar, picture])


def with_scale(picture: Callable[[slice], UInt8[np.ndarray, "r w 3"]], h: int, w: int) -> Rows:
    """A map of errors in degrees over what its colours mean, some rows at a time, and its size (h2, w2).

    `picture` makes some rows of the map (h, w); narrow ones become NARROWEST pixels wide.
    """
    width, unit = max(w, NARROWEST), max(1.0, max(h, w) / 1000)  # letters grow with large pictures
    bar, line = round(12 * unit), round(18 * unit)
    below = np.full((4 + bar + line, width, 3), 255, np.uint8)
    below[4 : 4 + bar] = colours(np.linspace(0, SCALE_DEG, width)[None])
    for k in range(TICKS):
        degrees = SCALE_DEG * k / (TICKS - 1)
        text = f"{degrees:g}" if k < TICKS - 1 else f"{degrees:g}+ deg"
        size = _size(text, LARGEST * 0.9 * unit)
        at = round(k / (TICKS - 1) * width - size * k / (TICKS - 1))
        _write(below, text, at, 4 + bar + round(13 * unit), LARGEST * 0.9 * unit, width)

    def rows(some: slice) -> UInt8[np.ndarray, "r w2 3"]:
        shown = picture(slice(min(some.start, h), min(some.stop, h)))
        wide = np.pad(shown, ((0, 0), (0, width - w), (0, 0)), constant_values=255)
        return np.concatenate([wide, below[max(0, some.start - h) : max(0, some.stop - h)]])

    return rows, (h + len(below), width)


def _size(text: str, scale: float) -> int:
    import cv2

    return cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0]


def _write(picture: np.ndarray, text: str, x: int, y: int, scale: float, width: int) -> None:
    import cv2

    scale *= min(1.0, max(width, 1) / max(_size(text, scale), 1))
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, INK, max(1, round(scale)), cv2.LINE_AA)
