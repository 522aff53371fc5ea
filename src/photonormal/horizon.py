"""Walks over a height field in one direction, from all of its points at once."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np


def walk(x: float, y: float, shape: tuple[int, int], growth: float) -> Iterator[tuple[Any, Any, float]]:
    """Slices of points, those of the points beyond them, and how far these lie, nearest first.

    Parameters
    ----------
    x, y : unit vector to the right and up
    shape : rows and columns
    growth : of each step over the one before; steps are of one pixel at least
    """
    h, w = shape
    done, distance = {(0, 0)}, 1.0
    while distance < np.hypot(h, w):
        row, column = round(-y * distance), round(x * distance)
        distance = max(distance * growth, distance + 1)
        if (row, column) in done or abs(row) >= h or abs(column) >= w:
            continue
        done.add((row, column))
        here = np.s_[max(-row, 0) : h - max(row, 0), max(-column, 0) : w - max(column, 0)]
        there = np.s_[max(row, 0) : h + min(row, 0), max(column, 0) : w + min(column, 0)]
        yield here, there, float(np.hypot(row, column))
