"""Least squares of what a pixel shows over a basis of the light, some rows after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from photonormal.files.rows import Rows
from photonormal.masked import box_of, picked, row_bands
from photonormal.methods.engine import plan
from photonormal.progress import progress
from photonormal.relighting.bases import Basis
from photonormal.srgb import from_linear
from photonormal.types import Capture, InputError, Mask

FEWEST = 6  # terms of a fit, those of ptm
ROWS = 256  # of each photograph that show what is white
BRIGHTEST = 0.999  # share of the samples that are at most white
PIXELS = 2**17  # fitted at a time: memory that is asked for anew costs more than reading in smaller parts
BLOCK = 2**15  # samples encoded at a time: they fit into a cache
RIDGE = 1e-4  # about the squared error that 8 bits leave, over white: what lights show less of stays short
PIECE = 2**20  # numbers of all layers that are worked on at a time


@dataclass(frozen=True)
class RelightingFit:
    """The least-squares fit of a capture's photographs, as they look on a screen, by a basis.

    Coefficients C minimise |B C - I|^2 + ridge trace(B'B) |C|^2, so that those stay short that lights show little of:
    long ones, which cancel each other under the lights that there are, would be stored too coarsely.

    Raises
    ------
    InputError
        If the capture has no lights, or fewer than the basis has terms.
    """

    capture: Capture
    basis: Basis
    ridge: float = RIDGE

    def __post_init__(self) -> None:
        n, k = self.capture.images.shape[0], self.terms
        if n < k:
            fewer = (
                "choose a fit of 6 terms: --to ptm, --by ptm"
                if n >= FEWEST
                else "choose what needs no fit: gltf, maps, --by matt"
            )
            raise InputError(
                f"{n} photographs came but a fit of {k} terms needs at least {k}; add photographs, or {fewer}."
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

    @contextmanager
    def layers(self) -> Iterator[list[Rows]]:
        """The coefficients (h, w, c) of each term over the mask's box, on disk; outside the mask they are 0."""
        mask, box = self.capture.mask, box_of(self.capture.mask)
        white, c = self.white(), self.capture.images.shape[3]
        first = 0
        with ExitStack() as kept:
            layers = [kept.enter_context(Rows((*self.size, c), np.float32)) for _ in range(self.terms)]
            with progress("fit to the light", int(mask.sum())) as advance:
                for rows in row_bands(mask, min(PIXELS, plan.pixels(self.capture))):
                    on = mask[rows, box[1]]
                    shown = self._shown(rows, box[1], on, white)
                    fitted = self._fitted(shown, slice(first, first + shown.shape[1]))
                    first += shown.shape[1]
                    for layer, values in zip(layers, fitted, strict=True):
                        part = np.zeros((*on.shape, c), np.float32)
                        part[on] = values
                        layer[rows.start - box[0].start : rows.stop - box[0].start] = part
                    advance(shown.shape[1])
            yield layers

    def _shown(self, rows: slice, columns: slice, on: Mask, white: float) -> Float[np.ndarray, "n p c"]:
        """What the photographs show of the pixels `on` of a window, sRGB-encoded, from 0 to 1."""
        n, _, _, c = self.capture.images.shape
        shown = np.empty((n, int(on.sum()), c), np.float32)

        def read(j: int) -> None:
            linear, encoded = picked(self.capture.window(j, rows, columns), on).reshape(-1), shown[j].reshape(-1)
            for first in range(0, len(linear), BLOCK):
                block = slice(first, first + BLOCK)
                encoded[block] = from_linear((linear[block] / np.float32(white)).clip(0, 1))

        self.capture.each_image(read)
        return shown

    def _fitted(self, shown: Float[np.ndarray, "n p c"], pixels: slice) -> Float[np.ndarray, "k p c"]:
        """The coefficients of some of the mask's pixels."""
        n, p, c = shown.shape
        lights_at = self.capture.lights_at
        if lights_at is None:
            inverse = self._inverse(self.basis(self.capture.known_lights())).astype(np.float32)
            return (inverse @ shown.reshape(n, -1)).reshape(-1, p, c)
        fitted, some = np.empty((self.terms, p, c), np.float32), max(1, BLOCK // n)
        for first in range(0, p, some):
            last = min(first + some, p)
            B = self.basis(lights_at[pixels.start + first : pixels.start + last].astype(np.float64))  # (some, n, k)
            fitted[:, first:last] = (self._inverse(B) @ shown[:, first:last].swapaxes(0, 1)).swapaxes(0, 1)
        return fitted

    def _inverse(self, B: Float[np.ndarray, "*p n k"]) -> Float[np.ndarray, "*p k n"]:
        """From samples to coefficients."""
        gram = B.swapaxes(-1, -2) @ B
        gram += self.ridge * np.trace(gram, axis1=-2, axis2=-1)[..., None, None] * np.eye(self.terms)
        return np.linalg.solve(gram, B.swapaxes(-1, -2))


def pieces(layers: Sequence[Rows | np.ndarray]) -> Iterator[tuple[slice, Float[np.ndarray, "k rows w 3"]]]:
    """Some rows after the other of all layers; red, green and blue are alike where the photographs are grey."""
    h, w, c = layers[0].shape
    rows = max(1, PIECE // (len(layers) * w * c))
    for y in range(0, h, rows):
        some = slice(y, min(y + rows, h))
        part = np.stack([layer[some] for layer in layers])
        yield some, np.broadcast_to(part, (*part.shape[:3], 3))
