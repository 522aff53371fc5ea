"""Samples that were cut off to whole grey levels: what they lost on average, half a level, is given back.

A file of 8 bits holds e I / s rounded to a whole number, or cut off where bits were dropped; s is a level. Cut off, a
dark picture is too contrasted everywhere. Lights of different intensities e tell the two apart: what is lost of the
radiance I, b s / e, depends on e alone, whereas shading, gloss and shadows follow the lights' directions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from photonormal.shading import LUMA
from photonormal.types import Capture, Image, Images, window_of

LEVELS = 255
FEWEST, SPREAD = 20, 0.1  # lights, and relative deviation of their intensities, that can tell
PIXELS, ROWS = 3000, 24  # looked at, on so many rows
MIDDLING = 0.35, 0.85  # quantiles of a pixel's shading between which its samples are taken: no shadow, no highlight
LOST, MOST = 0.22, 0.8  # levels that samples lack, for a half to be given back
SURE = 0.1  # largest deviation of how many they lack
TRIES, OUTLIERS, FAR = 1000, 0.4, 4.0  # of a few lights each; share of images that may be wrong; deviations


def given_back(capture: Capture) -> Capture:
    """The capture with half a level added to its samples, where they were cut off; else itself."""
    level = _level(capture)
    if level is None or capture.lights is None:
        return capture
    b, deviation = missing(_greys(capture), level @ _weights(level), capture.known_lights())
    if not (LOST < b < MOST and deviation < SURE):
        return capture
    half = (level / 2).astype(np.float32)
    assert capture.saturation is not None
    return replace(capture, images=Raised(capture.images, half), saturation=capture.saturation + half)


def missing(
    I: Float[np.ndarray, "p n"], level: Float[np.ndarray, " n"], L: Float[np.ndarray, "n 3"]
) -> tuple[float, float]:
    """How much samples lack on average, in grey levels, and the deviation of that figure.

    `level` is what a grey level is worth in each image, in the unit of the grey samples `I`.
    """
    weight, fit = np.ones_like(I), np.zeros_like(I)
    for turn in range(3):
        if turn:
            low, high = np.quantile(fit, MIDDLING, axis=1)[..., None]
            weight = ((fit >= low) & (fit <= high)).astype(float)
        A = np.einsum("pn,ni,nj->pij", weight, L, L) + 1e-9 * np.eye(3)
        fit = np.linalg.solve(A, np.einsum("pn,ni,pn->pi", weight, L, I)[..., None])[..., 0] @ L.T
    bright = (weight * fit).sum(1) / weight.sum(1)
    some = bright > 0
    off = np.where(weight[some] > 0, (I[some] - fit[some]) / bright[some, None], np.nan)
    seen = np.isfinite(off).sum(0) > some.sum() / 20
    r = np.nanmedian(off[:, seen], axis=0) * np.median(bright[some])  # of each image
    x, y, z = L[seen].T
    terms = np.stack([-level[seen], np.ones_like(x), x, y, z, x * x, y * y, x * y, x * z, y * z], 1)
    return _robust(terms, r)


def _robust(A: Float[np.ndarray, "n k"], y: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """The first coefficient of A c = y, and its deviation: least quantile of the residuals, then Tukey's weights."""
    n, k = A.shape
    if n < FEWEST:
        return 0.0, np.inf
    g = np.random.default_rng(0)
    few = np.argsort(g.random((TRIES, n)), axis=1)[:, : k + 4]
    found = (np.linalg.pinv(A[few]) @ y[few][..., None])[..., 0]  # (tries, k)
    c = found[np.quantile(np.abs(y - found @ A.T), 1 - OUTLIERS, axis=1).argmin()]
    s, w = np.inf, np.ones(n)
    for _ in range(20):
        residual = y - A @ c
        s = 1.48 * np.median(np.abs(residual)) + 1e-12
        w = np.clip(1 - (residual / (FAR * s)) ** 2, 0, None) ** 2
        c = np.linalg.lstsq(A * np.sqrt(w)[:, None], y * np.sqrt(w), rcond=None)[0]
    return float(c[0]), float(s * np.sqrt(np.linalg.pinv((A * w[:, None]).T @ A)[0, 0]))


def _level(capture: Capture) -> Float[np.ndarray, "n c"] | None:
    """Radiance of a grey level; None where the files are not linear ones of 8 bits, or can't tell what is missing."""
    if getattr(capture.images, "dtype", None) != np.uint8 or capture.saturation is None or capture.linearised:
        return None
    level = np.asarray(capture.saturation, float) / LEVELS
    grey = level @ _weights(level)
    return None if len(grey) < FEWEST or grey.std() < SPREAD * grey.mean() else level


def _weights(level: Float[np.ndarray, "n c"]) -> np.ndarray:
    return np.asarray(LUMA if level.shape[1] == 3 else (1.0,))


def _greys(capture: Capture) -> Float[np.ndarray, "p n"]:
    """Grey samples of some pixels of the mask, on a few rows."""
    lines = np.flatnonzero(capture.mask.any(1))
    lines = lines[np.unique(np.linspace(0, len(lines) - 1, ROWS).round().astype(int))]
    step = max(1, int(capture.mask[lines].sum()) // PIXELS)

    def of_image(j: int) -> np.ndarray:
        rows = [window_of(capture.images, j, slice(y, y + 1), slice(None))[0][capture.mask[y]] for y in lines]
        samples = np.concatenate(rows)[::step]
        return samples @ _weights(samples)

    return np.stack(capture.each_image(of_image), axis=1)


class Raised:
    """Pictures with half a level added wherever there is light at all (`photonormal.types.Images`)."""

    def __init__(self, images: Images, half: Float[np.ndarray, "n c"]):
        self.images, self.half, self.shape = images, half, images.shape

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of one picture."""
        image = window_of(self.images, j, rows, columns)
        return np.where(image > 0, image + self.half[j], image)

    def __getitem__(self, j: int, /) -> Image:
        return self.window(j, slice(None), slice(None))
