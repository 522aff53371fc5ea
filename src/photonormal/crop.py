"""Which part of the photographs a capture shows, and how much smaller; whatever is given in pixels follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from photonormal.errors import InputError
from photonormal.lamps import Camera, Lamps
from photonormal.options import Scale, check_value


@dataclass(frozen=True)
class Crop:
    """A part of photographs, reduced.

    Parameters
    ----------
    x, y : its first column and row in the photographs
    width, height : its size there, pixels
    photographs : (rows, columns) of the whole frame
    scale : by which it is reduced, above 0 and at most 1
    """

    x: int
    y: int
    width: int
    height: int
    photographs: tuple[int, int]
    scale: float = 1.0

    @staticmethod
    def chosen(text: str | Sequence[int], scale: float, photographs: tuple[int, int], called: str) -> Crop | None:
        """The crop "x,y,width,height", or those numbers; None where it is empty and nothing is reduced.

        `called` is where it stands, for messages.
        """
        check_value(scale, Scale, "--scale")
        h, w = photographs
        if not text and scale == 1:
            return None
        try:
            values = [int(v) for v in (text.split(",") if isinstance(text, str) else text)] if text else [0, 0, w, h]
            x, y, width, height = values
        except (TypeError, ValueError):
            raise InputError(
                f"{called} {str(text)[:40]!r} came but x,y,width,height in whole pixels is needed; correct it."
            ) from None
        if min(x, y) < 0 or min(width, height) < 1 or x + width > w or y + height > h:
            raise InputError(
                f"{called} {x},{y},{width},{height} lies outside the photographs, which are {w} x {h} pixels; give "
                "x,y,width,height inside them."
            )
        crop = Crop(x, y, width, height, (h, w), float(scale))
        if min(crop.shape) < 1:
            raise InputError(f"--scale {scale:g} leaves no pixel of {width} x {height}; give a larger one.")
        return crop

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns that are left."""
        return round(self.height * self.scale), round(self.width * self.scale)

    @property
    def box(self) -> tuple[slice, slice]:
        """Its rows and columns in the photographs."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def inside(self, mask: np.ndarray | None) -> np.ndarray:
        """A mask of the photographs (h, w), none of it outside the crop; None: all of it inside."""
        kept = np.zeros(self.photographs, bool)
        kept[self.box] = True if mask is None else mask[self.box]
        if not kept.any():
            raise InputError(
                f"the crop {self.x},{self.y},{self.width},{self.height} shows nothing of what the mask has as the "
                "object; choose another crop or mask."
            )
        return kept

    def matrix(self, K: np.ndarray) -> np.ndarray:
        """The photographs' camera matrix (3, 3), pixels, as one of the crop."""
        if K.shape != (3, 3):
            raise InputError(f"the camera matrix is {K.shape} but (3, 3) is needed; give K alone.")
        s = self.scale
        return np.array([[s, 0, s * (0.5 - self.x) - 0.5], [0, s, s * (0.5 - self.y) - 0.5], [0, 0, 1]]) @ K

    def camera(self, camera: Camera) -> Camera:
        """The photographs' camera as the crop's."""
        return Camera(camera.mm_per_px / self.scale, None if camera.K is None else self.matrix(camera.K))

    def origin_mm(self, camera: Camera) -> np.ndarray:
        """The origin of the crop's positions as a position (3,) in the photographs; `camera` is the crop's."""
        if camera.K is not None:
            return np.zeros(3)
        (h, w), (rows, columns), s = self.photographs, self.shape, self.scale
        x, y = (self.x - w / 2) * s + columns / 2, (self.y - h / 2) * s + rows / 2  # pixels of the crop
        return camera.mm_per_px * np.array([x, -y, 0.0])

    def lamps(self, lamps: Lamps, camera: Camera) -> Lamps:
        """The photographs' lamps as the crop's; so is `camera`."""
        return replace(lamps, positions_mm=lamps.positions_mm - self.origin_mm(camera))

    def as_dict(self) -> dict[str, Any]:
        """For reports."""
        return asdict(self)
