"""What has to be taken out of photographs as they come: dark frame, flat field, hot pixels, lens distortion.

A sample is s = g (e I) + d with the dark level d and the flat field g: I = (s - d) / (g e). A white board that faces
the camera under each light shows g e l_z, fall-off and all.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from math import prod
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from photonormal.capture.encoding import Encoding, encoding_of
from photonormal.capture.images import ImageFiles
from photonormal.capture.lens import Lens
from photonormal.capture.store import Framed
from photonormal.files.decode import decode, frame_of, full_scale
from photonormal.types import Image, InputError

GRAZING = 0.05  # cosine of a light on a board, at least
MOST_WHITE = 0.05  # part of a flat field or board as bright as its file can hold, at most: it shows no brightness there
LEAST_FLAT = 0.02  # of the flat field's median: darker places hold no light to divide by
HOT, RATIO = 0.03, 1.5  # of full scale, and times the median of its neighbours: above both a pixel is hot


class Corrected:
    """Pictures (n, h, w, c) of another sequence, corrected one by one (`photonormal.types.Images`).

    Parameters
    ----------
    images : linear radiance divided by the intensities of the lights
    dark : (h, w, 1 or c) level with all lights off, as a fraction of full scale; or None. Of pictures that are one
        channel each (h, w, 3): each picture's channel counts
    flat : as `dark`, relative brightness of an even white surface; a function of the picture's number where it differs;
        or None
    hot : (h, w) bool, pixels to be replaced by the median of their neighbours; or None
    lens : whose distortion is taken out; or None
    box : rows and columns outside of which the corrected pictures are zero
    """

    def __init__(
        self,
        images: ImageFiles,
        dark: np.ndarray | None = None,
        flat: np.ndarray | Callable[[int], np.ndarray] | None = None,
        hot: Bool[np.ndarray, "h w"] | None = None,
        lens: Lens | None = None,
        box: tuple[slice, slice] | None = None,
    ):
        self.images, self.dark, self.flat, self.hot, self.lens = images, dark, flat, hot, lens
        self.shape, self.dtype, self.intensities = images.shape, images.dtype, images.intensities
        box = (slice(0, self.shape[1]), slice(0, self.shape[2])) if box is None else box
        self._kept = Framed(self.shape, box, np.dtype(np.float32), lambda j: self.decoded(j)[box])
        self._white: dict[int, bytes] = {}  # picture -> where its samples were saturated, a bit each, compressed

    def __getitem__(self, j: int) -> Image:
        return self.window(j, slice(None), slice(None))

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of picture `j`; each is corrected once, and kept."""
        return self._kept.image(j, rows, columns)

    def saturated(self, j: int, rows: slice, columns: slice) -> Bool[np.ndarray, "h w c"] | None:
        """Where the sensor cut off what a part of picture `j` shows, which no level shows once it is corrected."""
        if self.images.saturation is None:
            return None
        if j not in self._white:
            self.window(j, slice(0, 1), slice(0, 1))
        bits = np.frombuffer(zlib.decompress(self._white[j]), np.uint8)
        return np.unpackbits(bits, count=prod(self.shape[1:])).reshape(self.shape[1:])[rows, columns] > 0

    def decoded(self, j: int) -> Image:
        """Picture `j`, decoded and corrected anew, and not kept."""
        image = self.images.decoded(j)
        white = None if self.images.saturation is None else image >= self.images.saturation[j] * (1 - 1e-5)
        if self.dark is not None:
            image = np.maximum(image - self.images.own(self.dark, j) / self.intensities[j], 0)
        if self.hot is not None and self.hot.any():
            image = np.where(self.hot[..., None], neighbours(image), image)
        if self.flat is not None:
            image = image / self.images.own(self.flat(j) if callable(self.flat) else self.flat, j)
        if self.lens is not None:
            image = self.lens.undistorted(image)
            white = None if white is None else self.lens.undistorted(white.astype(np.uint8), nearest=True) > 0
        if white is not None:
            self._white[j] = zlib.compress(np.packbits(white).tobytes(), 1)
        return image.astype(np.float32, copy=False)

    def __len__(self) -> int:
        return self.shape[0]


def neighbours(image: Float[np.ndarray, "h w c"]) -> Float[np.ndarray, "h w c"]:
    """Median of each pixel's surroundings of 3 x 3, itself included."""
    import cv2

    return cv2.medianBlur(np.ascontiguousarray(image, np.float32), 3).reshape(image.shape)


def read_frame(
    path: Path, shape: tuple[int, ...], what: str, encoding: Encoding, most_white: float = 1.0
) -> np.ndarray:
    """A dark frame or flat field (h, w, c) as a fraction of full scale, linear.

    `encoding` is that of the photographs, which holds where the file says nothing or the user says what it is; of its
    pixels at most a part `most_white` may be at full scale.
    """
    frame = frame_of(path)
    samples = decode(path) if frame == tuple(shape[:2]) else None
    if samples is None or samples.shape[2] not in (1, shape[2]):
        came = frame if samples is None else samples.shape
        raise InputError(
            f"the {what} {path} is {came} but the photographs are {tuple(shape)}; take it with the same camera and "
            "settings."
        )
    white = float((samples == full_scale(samples)).any(-1).mean()) if samples.dtype.kind == "u" else 0.0
    if white > most_white:
        raise InputError(
            f"{100 * white:.0f} % of the {what} {path} is white, where its brightness can't be measured; "
            "expose less, and photograph it again."
        )
    own = encoding if encoding.by_user else encoding_of(path)
    encoding = own if own.declared else encoding
    if encoding.curves and samples.dtype.kind == "u":
        return encoding.linear(samples)
    return samples.astype(np.float32) / np.float32(full_scale(samples))


def flat_field(level: np.ndarray, dark: np.ndarray | None, path: Path) -> np.ndarray:
    """Relative brightness, its median 1, of the flat field's level (h, w, c)."""
    level = level if dark is None else np.maximum(level - dark, 0)
    middle = np.median(level, axis=(0, 1))
    if not (middle > 0).all():
        raise InputError(f"the flat field {path} is black on most of the frame; photograph an even white surface.")
    flat = level / middle
    if (flat < LEAST_FLAT).any():
        part = 100 * float((flat < LEAST_FLAT).mean())
        raise InputError(f"{part:.2g} % of the flat field {path} is black; photograph an even white surface.")
    return flat


class FlatFields:
    """Relative brightness of a white board under each light: what the picture of that light is to be divided by.

    Parameters
    ----------
    paths : the n pictures of the board, which faces the camera
    shape : (h, w, c) of the photographs
    dark : their dark level, or None
    encoding : the photographs', see `read_frame`
    cosines : (n,) of the lights and the camera's axis, which the board shows too; or None
    exposures : (n,) of the board's pictures
    """

    def __init__(
        self,
        paths: Sequence[Path],
        shape: tuple[int, ...],
        dark: np.ndarray | None,
        encoding: Encoding,
        cosines: Float[np.ndarray, " n"] | None,
        exposures: Float[np.ndarray, " n"],
    ):
        self.paths, self.shape, self.dark, self.encoding, self.exposures = paths, shape, dark, encoding, exposures
        self.cosines = np.ones(len(paths)) if cosines is None else cosines
        medians = [float(np.median(self._level(j))) for j in range(len(paths))]
        black = [path for path, middle in zip(paths, medians, strict=True) if middle <= 0]
        if black:
            raise InputError(f"the flat field {black[0]} is black on most of the frame; photograph a white board.")
        if self.cosines.min() < GRAZING:
            j = int(self.cosines.argmin())
            raise InputError(
                f"the light of the flat field {paths[j]} lies {np.degrees(np.arccos(self.cosines[j])):.0f} degrees off "
                "the camera's axis, so it does not reach a board that faces the camera; leave that light out."
            )
        self.middle = float(np.mean(medians / exposures))

    def __call__(self, j: int) -> np.ndarray:
        """(h, w, 1 or c); infinite where the board shows nothing, so that nothing is known there."""
        level = self._level(j) / (self.middle * float(self.exposures[j]))
        return np.where(level > LEAST_FLAT * np.median(level), level / self.cosines[j], np.inf)

    def _level(self, j: int) -> np.ndarray:
        level = read_frame(self.paths[j], self.shape, "flat field", self.encoding, MOST_WHITE)
        return level if self.dark is None else np.maximum(level - self.dark, 0)


def hot_pixels(level: Float[np.ndarray, "h w c"]) -> Bool[np.ndarray, "h w"]:
    """Pixels that stand out of their surroundings in a dark frame, or in the minimum over all pictures."""
    around = neighbours(level)
    return np.any((level > around + HOT) & (level > RATIO * around), axis=-1)
