"""One pass over a capture's pictures: what every test of the doctor needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibration.mask import mask_from_shading
from photonormal.doctor.finding import Finding
from photonormal.masked import box_of, made_smaller, on_rim, picked, row_bands
from photonormal.types import Capture, InputError

PIXELS = 20_000  # at most, on a regular grid: slopes of the normals need neighbours
MARGIN = 8  # pixels kept around the mask
SMALL = 300  # longest side of the pictures that show motion
GROUND = 0.15  # of the object's brightness, below which the ground around it is dark
CUT_OFF = 0.7  # part of the frame's rim that is object, as part of the frame that is, above which it is none
ROUND = 0.95  # of the frame's rim on the mask, from which on it is the ground that is marked, if that is dark
CAP = 0.995  # quantile of all samples above which they are cut: highlights say nothing of the order


@dataclass(frozen=True)
class Samples:
    """Grey levels of `n` pictures and counts of what their sensors could not hold.

    Parameters
    ----------
    I : (p, n) grey levels on the grid's pixels inside the mask
    mask : (h, w) bool, the grid
    grid : its rows and columns in the photographs
    saturated : (n,) fraction of the mask's samples
    small : (n, a, b) grey pictures of the mask's box at `scale`
    middle : where in them, row and column, the middle of the frame lies
    bits : 8, 12 or 16 that the samples really use; None for floats
    """

    I: Float[np.ndarray, "p n"]
    mask: Bool[np.ndarray, "h w"]
    grid: tuple[slice, slice]
    saturated: Float[np.ndarray, " n"]
    small: Float[np.ndarray, "n a b"]
    scale: float
    middle: tuple[float, float]
    bits: int | None


def read(capture: Capture) -> Samples:
    """Decode every picture once, in threads."""
    import cv2

    mask = capture.mask
    rows, columns = box_of(mask, MARGIN)
    object_rows, object_columns = box_of(mask)
    step = max(1, int(np.ceil(np.sqrt(mask.sum() / PIXELS))))
    grid = np.s_[object_rows.start :: step, object_columns.start :: step]
    scale = min(1.0, SMALL / max(mask[rows, columns].shape))
    bands = row_bands(np.ones((rows.stop - rows.start, columns.stop - columns.start), bool))
    kind = np.dtype(getattr(capture.images, "dtype", np.float32))

    def one(j: int) -> tuple[np.ndarray, float, np.ndarray, int]:
        white = np.inf if capture.saturation is None else capture.saturation[j]
        grey = np.empty((rows.stop - rows.start, columns.stop - columns.start), np.float32)
        saturated, on_grid = 0.0, []
        for band in bands:
            at = slice(rows.start + band.start, rows.start + band.stop)
            image = capture.window(j, at, columns)
            white_ones = capture.saturated(j, at, columns, image)
            saturated += np.count_nonzero(picked(white_ones, mask[at, columns])) / image.shape[2]
            grey[band] = cv2.transform(image, np.full((1, image.shape[2]), 1 / image.shape[2], np.float32))
            first = (object_rows.start - at.start) % step, object_columns.start - columns.start
            some = np.s_[first[0] :: step, first[1] :: step]
            on_grid.append(image[some][mask[at, columns][some]])
        inside, count = np.concatenate(on_grid), int(mask.sum())
        return (
            inside.mean(-1),
            saturated / count,
            made_smaller(grey, scale),
            _bits(inside, white) if kind == np.uint16 else 8 * kind.itemsize,
        )

    I, saturated, small, bits = zip(*capture.each_image(one), strict=True)
    levels = np.stack(I, axis=-1).astype(np.float64)
    return Samples(
        np.minimum(levels, np.quantile(levels, CAP)),
        mask[grid],
        grid,
        np.array(saturated),
        np.stack(small),
        scale,
        (_middle(rows, mask.shape[0], scale), _middle(columns, mask.shape[1], scale)),
        max(bits) if kind.kind == "u" else None,
    )


def on_object(samples: Samples) -> tuple[Float[np.ndarray, "p n"], Bool[np.ndarray, "h w"]]:
    """Grey levels and mask of the object; where no mask was given, of what stands out of the ground, if anything does.

    The ground is seldom lit as evenly as the tests of the lights suppose, and has no outline.
    """
    if not samples.mask.all() or not (samples.I > 0).any():
        return samples.I, samples.mask
    try:
        mask = mask_from_shading(samples.I.T.reshape(-1, *samples.mask.shape))
    except InputError:
        return samples.I, samples.mask
    level = np.quantile(samples.I, 0.9, axis=1)
    if on_rim(mask) > CUT_OFF * mask.mean():
        return samples.I, samples.mask  # patches of what fills the frame
    if mask.all() or np.median(level[~mask.ravel()]) > GROUND * np.median(level[mask.ravel()]):
        return samples.I, samples.mask  # paint, or a shining spot
    return samples.I[mask.ravel()], mask


def inverted(mask: Bool[np.ndarray, "h w"], samples: Samples) -> list[Finding]:
    """Where the mask marks what lies around the object: it goes round the frame, dark beside what it leaves out."""
    import cv2

    if mask.all() or on_rim(mask) < ROUND:
        return []
    level = samples.small.mean(axis=0)  # (a, b), of the whole frame where its rim is on the mask
    small = cv2.resize(mask.astype(np.uint8), level.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    if not 0 < small.mean() < 1:
        return []
    marked, left = float(np.quantile(level[small], 0.9)), float(np.median(level[~small]))
    if marked >= GROUND * left:
        return []
    times = f"{left / marked:.0f}" if 100 * marked > left else "more than 100"
    message = (
        f"the mask looks inverted: the white part goes round the frame and is {times} times as "
        "dark as the black part. White has to mark the object: invert the mask, or name another with --mask."
    )
    return [Finding("mask", True, message, {"marked_over_left": round(marked / left, 4)})]


def no_mask(given: Bool[np.ndarray, "h w"], judged: Bool[np.ndarray, "h w"]) -> list[Finding]:
    """Where no mask was given and only a part of the frame is the object."""
    if judged.sum() == given.sum():
        return []
    part = 100 * float(judged.mean())
    message = (
        f"no mask was given, so the check took the bright part, {part:.0f} % of the frame, for the object. "
        "`photonormal mask FOLDER --out FOLDER/mask.png` draws a mask, which keeps the dark ground out of the results."
    )
    return [Finding("mask", False, message, {"object_percent": round(part, 2)})]


def _bits(samples: np.ndarray, white: np.ndarray | float) -> int:
    """Bits that the samples of a 16-bit file use: 8 where all are multiples of 257, 12 where none is above 4095."""
    if not np.all(np.isfinite(white)):
        return 16
    values = np.rint(samples[:: max(1, len(samples) // 4096)] / white * 65535).astype(np.int64)
    if (values % 257 == 0).all():
        return 8
    return 12 if values.max() <= 4095 else 16


def _middle(part: slice, size: int, scale: float) -> float:
    """Where the middle of `size` pixels lies in a part of them that is made smaller."""
    return scale * (size / 2 - part.start) - 0.5
