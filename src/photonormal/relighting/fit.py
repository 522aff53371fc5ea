"""Least squares of what a pixel shows over a basis of the light, some rows after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from photonormal.masked import row_bands
from photonormal.methods.engine import plan
from photonormal.relighting.bases import Basis
from photonormal.srgb import from_linear
from photonormal.types import Capture, InputError, box_of

ROWS = 256  # of each photograph that tell what is white
BRIGHTEST = 0.999  # share of the samples that are at most white


@dataclass(frozen=True)
class Band:
    """The fit of some rows of the mask's box.

    Parameters
    ----------
    rows : which rows of the box
    on : (h, w) bool, where the mask has pixels in them
    coefficients : (p, k, c) of those pixels
    shown : (p, n, c) the samples that were fitted: sRGB-encoded, from 0 to 1
    """

    rows: slice
    on: Bool[np.ndarray, "h w"]
    coefficients: Float[np.ndarray, "p k c"]
    shown: Float[np.ndarray, "p n c"]

    @property
    def rgb(self) -> Float[np.ndarray, "p k 3"]:
        """Coefficients of red, green and blue, alike where the photographs are grey."""
        return np.broadcast_to(self.coefficients, (*self.coefficients.shape[:2], 3))


@dataclass(frozen=True)
class Fit:
    """The least-squares fit of a capture's photographs, as they look on a screen, by a basis; found anew when asked.

    Where lights are too few or too alike to tell all terms, the shortest coefficients are taken.

    Raises
    ------
    InputError
        If the capture has no lights, or fewer than the basis has terms.
    """

    capture: Capture
    basis: Basis

    def __post_init__(self) -> None:
        n, k = self.capture.images.shape[0], self.terms
        if n < k:
            raise InputError(
                f"{n} photographs came but a fit of {k} terms needs at least {k}; add photographs, or choose a format "
                "with fewer terms: ptm has 6."
            )

    @property
    def terms(self) -> int:
        """Coefficients of a pixel and channel."""
        return self.basis(self.capture.known_lights()[:1]).shape[-1]

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of the mask's box."""
        rows, columns = box_of(self.capture.mask)
        return rows.stop - rows.start, columns.stop - columns.start

    def white(self) -> float:
        """The radiance that is shown white: nearly all samples on the mask are darker."""
        mask, columns = self.capture.mask, box_of(self.capture.mask)[1]
        lines = np.flatnonzero(mask.any(1))
        lines = lines[:: max(1, len(lines) // ROWS)]

        def samples(j: int) -> np.ndarray:
            parts = [self.capture.window(j, slice(y, y + 1), columns)[0][mask[y, columns]] for y in lines]
            return np.quantile(np.concatenate(parts), BRIGHTEST)

        return max(float(max(self.capture.each_image(samples))), 1e-6)

    def bands(self, white: float) -> Iterator[Band]:
        """The whole fit, some rows after the other."""
        capture = self.capture
        n, _, _, c = capture.images.shape
        box = box_of(capture.mask)
        shared = None if capture.lights_at is not None else np.linalg.pinv(self.basis(capture.known_lights()))
        first = 0
        for rows in row_bands(capture.mask, plan.pixels(capture)):
            on = capture.mask[rows, box[1]]
            shown = np.empty((int(on.sum()), n, c), np.float32)

            def read(j: int, rows: slice = rows, on: np.ndarray = on, shown: np.ndarray = shown) -> None:
                shown[:, j] = from_linear((capture.window(j, rows, box[1])[on] / white).clip(0, 1))

            capture.each_image(read)
            here = slice(first, first + len(shown))
            first = here.stop
            inverse = shared
            if inverse is None:
                assert capture.lights_at is not None
                inverse = np.linalg.pinv(self.basis(capture.lights_at[here].astype(np.float64)))
            inside = slice(rows.start - box[0].start, rows.stop - box[0].start)
            yield Band(inside, on, inverse.astype(np.float32) @ shown, shown)
