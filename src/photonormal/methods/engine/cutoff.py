"""Samples that were cut off to whole grey levels: what they lost on average, half a level, is given back.

A file holds e I / s rounded to a whole number, or cut off where bits were dropped; s is a level. Cut off, a dark
picture is too contrasted everywhere. Lights of different intensities e tell the two apart: what is lost of the radiance
I, b s / e, depends on e alone, whereas shading, gloss and shadows follow the lights' directions. A file may also hold
the middle of each step: then no sample lacks anything, but black is half a level.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from photonormal.methods.engine.looks import looked_at, of_some
from photonormal.methods.engine.samples import grey_levels
from photonormal.methods.engine.zeros import Filled
from photonormal.methods.inputs.grey import grey_samples
from photonormal.types import Capture, Image, Images, window_of

MIDDLE = 0.75  # levels: above black, which is stored as 0.5, and below the next level
WHOLE = 0.1  # by which samples are off whole numbers, at most, where a file holds them
COARSE = 10.0  # median sample that is not black, in levels, below which zeros are looked at
FEWEST, SPREAD = 20, 0.1  # lights, and relative deviation of their intensities, that suffice
MIDDLING = 0.35, 0.85  # quantiles of a pixel's shading between which its samples are taken: no shadow, no highlight
LOST, MOST = 0.22, 0.8  # levels that samples lack, for a half to be given back
SURE = 0.1  # largest deviation of how many they lack
TRIES, OUTLIERS, FAR = 1000, 0.4, 4.0  # of a few lights each; share of images that may be wrong; deviations


def given_back(capture: Capture) -> Capture:
    """The capture without what whole grey levels took; itself where files hold levels enough, or don't show it.

    Its notes say what was done: half a level was added to samples that were cut off; black that was stored as half a
    level is black; and dark pictures are what `engine.zeros` makes of them.
    """
    levels = Quantisation.of(capture)
    if levels is None or capture.lights is None:
        return capture
    grey, half = grey_levels(capture, looked_at(capture.mask)).double().numpy(), np.zeros_like(levels.size)
    if levels.darkest:
        black, notes = MIDDLE, ["The darkest level is stored as the middle of its step; it is taken for black."]
    elif levels.uneven() and _cut_off(*missing(grey, levels.grey, capture.known_lights())):
        half = levels.size / 2
        black, notes = 0.0, ["Samples were cut off to whole levels; half a level was added to each that is not zero."]
    else:
        return capture
    assert capture.saturation is not None
    images, saturation = Repaired(capture.images, black * levels.size, half), capture.saturation + half
    repaired = replace(capture, images=images, saturation=saturation)
    lit = (grey / levels.grey)[grey > black * levels.grey]
    if len(lit) and np.median(lit) < COARSE and capture.lamps is None:
        repaired = replace(repaired, images=Filled(repaired, levels.size))
        notes.append(
            f"The pictures have few grey levels: half of the samples that are not black have at most "
            f"{np.median(lit):.1f}. They were set to what their channels allow together, zeros to what their pixels' "
            "other samples say."
        )
    return replace(repaired, notes=(*capture.notes, *notes))


def _cut_off(b: float, deviation: float) -> bool:
    return LOST < b < MOST and deviation < SURE


@dataclass(frozen=True)
class Quantisation:
    """The grey levels of files that hold whole ones.

    Parameters
    ----------
    size : (n, c) radiance of a level in each image
    darkest : what the lowest level is stored as, in levels: 0, or 0.5 where each is the middle of its step
    """

    size: Float[np.ndarray, "n c"]
    darkest: float

    @staticmethod
    def of(capture: Capture) -> Quantisation | None:
        """Those of linear files of 8 or 16 bits; None of others, and of files that have each of their 16 bits."""
        dtype = getattr(capture.images, "dtype", None)
        if dtype not in (np.uint8, np.uint16) or capture.saturation is None or capture.linearised:
            return None
        full, saturation = np.iinfo(dtype).max, capture.saturation
        counts = of_some(capture, lambda samples, j: samples / saturation[j] * full)
        whole = np.round(counts).astype(np.int64)
        if np.abs(counts - whole).max() > WHOLE:  # pictures that were reduced: means of whole numbers
            return Quantisation(_of_size(capture, 1 / full), 0.0) if dtype == np.uint8 else None
        darkest = int(whole.min())
        step = int(np.gcd.reduce(whole - darkest, axis=None))
        if step == 0 or (dtype == np.uint16 and step == 1):
            return None
        middle = step > 1 and abs(darkest % step - step / 2) <= 0.5
        return Quantisation(_of_size(capture, step / full), 0.5 if middle else 0.0)

    @property
    def grey(self) -> Float[np.ndarray, " n"]:
        """What a level is worth of grey."""
        return grey_samples(self.size).astype(float)

    def uneven(self) -> bool:
        """Whether lights differ enough, and are enough, to show what samples lack."""
        return len(self.grey) >= FEWEST and bool(self.grey.std() >= SPREAD * self.grey.mean())


def _of_size(capture: Capture, share: float) -> Float[np.ndarray, "n c"]:
    return (np.asarray(capture.saturation, float) * share).astype(np.float32)


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


class Repaired:
    """Pictures whose samples above `black` have `more` added; the others are black (`photonormal.types.Images`)."""

    def __init__(self, images: Images, black: Float[np.ndarray, "n c"], more: Float[np.ndarray, "n c"]):
        self.images, self.black, self.more, self.shape = images, black, more, images.shape

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of one picture."""
        image = window_of(self.images, j, rows, columns)
        return np.where(image > self.black[j], image + self.more[j], 0)

    def __getitem__(self, j: int, /) -> Image:
        return self.window(j, slice(None), slice(None))
