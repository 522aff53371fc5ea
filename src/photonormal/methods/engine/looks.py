"""Some of a capture's pixels, evenly spaced on a few rows; they stand for the whole capture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from photonormal.masked import CLOSE, box_of, thinned
from photonormal.types import UNITS, Capture, InputError, window_of

PIXELS, ROWS = 3000, 24  # looked at, on so many rows


def looked_at(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Where those pixels are."""
    lines = np.flatnonzero(mask.any(1))
    lines = lines[np.unique(np.linspace(0, len(lines) - 1, ROWS).round().astype(int))]
    found = np.zeros_like(mask)
    found[lines] = mask[lines]
    return thinned(found, max(1, int(found.sum()) // PIXELS))


def of_some(capture: Capture, of: Callable[[np.ndarray, int], np.ndarray]) -> np.ndarray:
    """What is made of those pixels' samples (p, c) in each image, row by row."""
    where = looked_at(capture.mask)
    lines, columns = np.flatnonzero(where.any(1)), box_of(capture.mask)[1]
    close = lines[-1] - lines[0] < CLOSE * len(lines)  # read together, with the rows between
    spans = [lines] if close else lines[:, None]
    inside = [np.flatnonzero(where[some, columns]) for some in spans]

    def of_image(j: int) -> np.ndarray:
        samples = []
        for some, pixels in zip(spans, inside, strict=True):
            rows = window_of(capture.images, j, slice(some[0], some[-1] + 1), columns)[some - some[0]]
            samples.append(rows.reshape(-1, rows.shape[2]).take(pixels, axis=0))
        return of(np.concatenate(samples), j)

    return np.stack(capture.each_image(of_image))


def refuse_huge(capture: Capture) -> None:
    """InputError where pictures that are decoded one by one are in a unit too small for squares of their samples."""
    brightest = float(_middle_row(capture)(0).max(initial=0))
    if brightest > UNITS[1]:
        raise InputError(
            f"the pictures of {capture.name} reach {brightest:.3g} but single precision needs {UNITS[1]:g} or less; "
            "divide all of them by one number."
        )


def refuse_alike(capture: Capture) -> None:
    """InputError where all pictures show the same, whatever their light, and not just black."""
    n, row = capture.images.shape[0], _middle_row(capture)
    first = row(0)
    if not first.any() or any((row(j) != first).any() for j in range(1, n)):
        return  # as a rule the second picture shows
    shown = of_some(capture, lambda samples, j: samples)
    if (shown == shown[0]).all():
        raise InputError(
            f"all {n} pictures of {capture.name} show the same but each needs a light of its own; give photographs "
            "under different lights."
        )


def _middle_row(capture: Capture) -> Callable[[int], Float[np.ndarray, "p c"]]:
    """What gives the samples of a picture at the mask's pixels of its middle row."""
    lines = np.flatnonzero(capture.mask.any(1))
    row = int(lines[len(lines) // 2])
    rows, columns = slice(row, row + 1), slice(0, capture.mask.shape[1])
    inside = capture.mask[rows]
    return lambda j: capture.window(j, rows, columns)[inside]
