"""One pass over a capture's pictures: what every test of the doctor needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibrate.mask import mask_from_shading
from photonormal.check.given import Near
from photonormal.types import Capture, InputError, Lamps

PIXELS = 20_000  # at most, on a regular grid: slopes of the normals need neighbours
EDGE_SIZE = 400  # longest side of the pictures whose edges tell motion
CAP = 0.995  # quantile of all samples above which they are cut: highlights say nothing of the order


@dataclass(frozen=True)
class Samples:
    """Grey levels of `n` pictures and counts of what their sensors could not hold.

    Parameters
    ----------
    I : (p, n) grey levels on the grid's pixels inside the mask
    mask : (h, w) bool, the grid
    grid : its rows and columns in the photographs
    saturated, zero : (n,) fraction of the mask's samples
    level : (n,) median grey level inside the mask, as a fraction of full scale
    edges : (n, a, b) strength of the pictures' edges, in [0, 1], in the mask's box at `scale`
    small : the pictures that they are of, and where their pixels lie in mm; None under distant lights
    bits : 8, 12 or 16 that the samples really use; None for floats
    """

    I: Float[np.ndarray, "p n"]
    mask: Bool[np.ndarray, "h w"]
    grid: tuple[slice, slice]
    saturated: Float[np.ndarray, " n"]
    zero: Float[np.ndarray, " n"]
    level: Float[np.ndarray, " n"]
    edges: Float[np.ndarray, "n a b"]
    small: tuple[Float[np.ndarray, "n a b"], Float[np.ndarray, "a b 3"]] | None
    scale: float
    bits: int | None


def read(capture: Capture) -> Samples:
    """Decode every picture once, in threads."""
    mask = capture.mask
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    box = np.s_[max(0, rows[0] - 8) : rows[-1] + 9, max(0, columns[0] - 8) : columns[-1] + 9]
    step = max(1, int(np.ceil(np.sqrt(mask.sum() / PIXELS))))
    grid = np.s_[rows[0] :: step, columns[0] :: step]
    scale = min(1.0, EDGE_SIZE / max(mask[box].shape))
    kind = np.dtype(getattr(capture.images, "dtype", np.float32))

    def one(j: int, image: np.ndarray) -> tuple[np.ndarray, float, float, float, np.ndarray, np.ndarray, int]:
        inside = image[mask]  # (p, c)
        white = np.inf if capture.saturation is None else capture.saturation[j]
        full = 1.0 if capture.saturation is None else float(np.mean(capture.saturation[j]))
        grey = image.mean(-1)
        small = _small(grey[box], scale)
        return (
            grey[grid][mask[grid]],
            float((inside >= white * (1 - 1e-5)).mean()),
            float((inside <= 0).mean()),
            float(np.median(inside)) / full,
            small,
            _edges(small),
            _bits(inside, white) if kind == np.uint16 else 8 * kind.itemsize,
        )

    I, saturated, zero, level, small, edges, bits = zip(*capture.map_images(one), strict=True)
    levels = np.stack(I, axis=-1).astype(np.float64)
    return Samples(
        np.minimum(levels, np.quantile(levels, CAP)),
        mask[grid],
        grid,
        np.array(saturated),
        np.array(zero),
        np.array(level),
        np.stack(edges),
        None if capture.lamps is None else (np.stack(small), _places(capture, box, small[0].shape)),
        scale,
        max(bits) if kind.kind == "u" else None,
    )


def on_object(samples: Samples) -> tuple[Float[np.ndarray, "p n"], Bool[np.ndarray, "h w"]]:
    """Grey levels and mask of the object; where no mask was given, of what stands out of the ground, if anything does.

    The ground is seldom lit as evenly as the tests of the lights suppose, and has no outline.
    """
    if not samples.mask.all():
        return samples.I, samples.mask
    try:
        mask = mask_from_shading(samples.I.T.reshape(-1, *samples.mask.shape))
    except InputError:
        return samples.I, samples.mask
    return samples.I[mask.ravel()], mask


def expected_edges(samples: Samples, lamps: Lamps) -> Float[np.ndarray, "n a b"]:
    """Edges of the pictures that the matt surface which explains all of them best would give under near lamps.

    Shading has edges of its own there, which move with the lamp.
    """
    assert samples.small is not None
    pictures, X = samples.small
    matt = Near(pictures.reshape(len(pictures), -1).T, X.reshape(-1, 3), lamps).matt()
    return np.stack([_edges(picture) for picture in matt.T.reshape(pictures.shape)])


def _places(capture: Capture, box: tuple[slice, slice], shape: tuple[int, ...]) -> Float[np.ndarray, "a b 3"]:
    """Where the pixels of a reduced picture of the box lie, on a plane at the object's mean depth."""
    import cv2

    assert capture.camera is not None
    X = capture.camera.plane_mm(*capture.mask.shape)[box]
    return cv2.resize(X, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)


def _bits(samples: np.ndarray, white: np.ndarray | float) -> int:
    """Bits that the samples of a 16-bit file use: 8 where all are multiples of 257, 12 where none is above 4095."""
    if not np.all(np.isfinite(white)):
        return 16
    values = np.rint(samples[:: max(1, len(samples) // 4096)] / white * 65535).astype(np.int64)
    if (values % 257 == 0).all():
        return 8
    return 12 if values.max() <= 4095 else 16


def _small(grey: np.ndarray, scale: float) -> np.ndarray:
    import cv2

    return cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else grey


def _edges(grey: np.ndarray) -> np.ndarray:
    """Strength of the edges of the logarithm: they stay where lights change, and move with the camera."""
    import cv2

    bright = max(float(np.quantile(grey, 0.95)), 1e-9)
    grey = grey.clip(0, 1e6 * bright)  # one glint of a float picture must not overflow
    log = cv2.GaussianBlur(np.log(grey / bright + 0.02).astype(np.float32), (0, 0), 1.0)
    m = np.hypot(*(cv2.Sobel(log, cv2.CV_32F, dx, 1 - dx, scale=1 / 8) for dx in (1, 0)))
    return m / (m + float(np.quantile(m, 0.9)) + 1e-6)
