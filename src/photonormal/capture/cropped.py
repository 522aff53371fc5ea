"""A part of a capture's photographs, and smaller ones, for a first look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from photonormal.capture.corrections import Corrected
from photonormal.capture.images import MARGIN, ImageFiles
from photonormal.capture.store import Framed
from photonormal.crop import Crop
from photonormal.masked import box_of, made_smaller
from photonormal.types import Capture, Image, InputError, Normals, saturated_in


def cropped(capture: Capture, images: ImageFiles | Corrected, crop: Crop) -> Capture:
    """The crop of a capture, whose `images` these are; lamps, camera, mask and truth follow."""
    mask = reduced(capture.mask, crop) > 0.5
    if not mask.any():
        raise InputError(f"--scale {crop.scale:g} leaves nothing of the object; give a larger one.")
    lamps, camera = capture.lamps, capture.camera
    if camera is not None:
        camera = crop.camera(camera)
        lamps = None if lamps is None else crop.lamps(lamps, camera)
    return replace(
        capture,
        images=Cropped(images, crop, box_of(mask, MARGIN)),
        mask=mask,
        lamps=lamps,
        camera=camera,
        truth=None if capture.truth is None else normals(capture.truth, crop),
        crop=crop,
    )


def normals(truth: Normals, crop: Crop) -> Normals:
    """Mean directions of the normals that are known."""
    map = reduced(truth.map, crop)
    length = np.linalg.norm(map, axis=-1)
    known = (reduced(truth.mask, crop) > 0.5) & (length > 0)
    return Normals(map / np.where(known, length, 1)[..., None], known)


def reduced(picture: np.ndarray, crop: Crop) -> np.ndarray:
    """The crop of a picture (h, w) or (h, w, c) of the photographs' size: means over areas, float32."""
    small = made_smaller(picture[crop.box].astype(np.float32), crop.scale)
    return small.reshape(*crop.shape, *picture.shape[2:])


class Cropped:
    """The crop of pictures (`photonormal.types.Images`); reduced ones are kept as float32, each decoded once.

    Parameters
    ----------
    images : the whole photographs, linear
    box : rows and columns of the crop outside of which it is zero where it is reduced
    """

    def __init__(self, images: ImageFiles | Corrected, crop: Crop, box: tuple[slice, slice]):
        self.images, self.crop, self.dtype = images, crop, images.dtype
        n, _, _, c = images.shape
        self.shape: tuple[int, int, int, int] = (n, *crop.shape, c)
        self._kept = Framed(self.shape, box, np.dtype(np.float32), lambda j: reduced(images.decoded(j), crop)[box])

    def __getitem__(self, j: int) -> Image:
        return self.window(j, slice(None), slice(None))

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of picture `j`, in pixels of the crop."""
        if self.crop.scale < 1:
            return self._kept.image(j, rows, columns)
        return self.images.window(j, *self._in_photographs(rows, columns))

    def saturated(self, j: int, rows: slice, columns: slice) -> Bool[np.ndarray, "h w c"] | None:
        """Where the photographs say so; of smaller ones, where most of what became a pixel is."""
        if self.crop.scale == 1:
            return saturated_in(self.images, j, *self._in_photographs(rows, columns))
        whole = saturated_in(self.images, j, slice(None), slice(None))
        return None if whole is None else reduced(whole, self.crop)[rows, columns] > 0.5

    def _in_photographs(self, rows: slice, columns: slice) -> tuple[slice, slice]:
        """Rows and columns of the crop where they lie in the photographs."""
        places = []
        for span, side, box in zip((rows, columns), self.crop.shape, self.crop.box, strict=True):
            first, last, step = span.indices(side)
            places.append(slice(box.start + first, box.start + last, step))
        return places[0], places[1]

    def __len__(self) -> int:
        return self.shape[0]
