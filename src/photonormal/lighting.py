"""Lights that were found from photographs, and photographs under them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from photonormal.types import Capture, Image, Images, saturated_in, window_of


@dataclass(frozen=True)
class FoundLights:
    """What the photographs of an object show of its lights.

    Parameters
    ----------
    lights : (n, 3) unit, from the surface to the light
    intensities : (n,) of mean 1, by which the photographs are to be divided; None: they stay as they are
    moved_deg : (n,) by how much each was turned from the one that was given, degrees; None: none were given
    notes : what can't be known, or is doubtful, a sentence each
    """

    lights: Float[np.ndarray, "n 3"]
    intensities: Float[np.ndarray, " n"] | None = None
    moved_deg: Float[np.ndarray, " n"] | None = None
    notes: tuple[str, ...] = ()

    def shown_by(self, capture: Capture) -> Capture:
        """The capture under these lights."""
        return under(capture, self.lights, self.intensities)

    def as_dict(self) -> dict[str, Any]:
        """For reports: `directions`, `intensities`, `moved_deg`, what is known of them."""
        known = {"directions": self.lights, "intensities": self.intensities, "moved_deg": self.moved_deg}
        return {k: np.round(v, 6).tolist() for k, v in known.items() if v is not None}


def under(
    capture: Capture, lights: Float[np.ndarray, "n 3"] | None, intensities: Float[np.ndarray, " n"] | None = None
) -> Capture:
    """The capture under other distant lights, and divided by other intensities, where there are any."""
    if intensities is not None:
        saturation = capture.saturation
        if saturation is not None:
            saturation = saturation / (intensities / intensities.mean())[:, None]
        capture = replace(capture, images=Divided(capture.images, intensities), saturation=saturation)
    return capture if lights is None else replace(capture, lights=lights, lamps=None)


def frontal(lights: Float[np.ndarray, "n 3"] | None) -> int:
    """Which photograph shows most: that of the light nearest to the camera; the first where lights are unknown."""
    return 0 if lights is None else int(np.argmax(lights[:, 2]))


class Divided:
    """Pictures over the intensities of their lights (`photonormal.types.Images`)."""

    def __init__(self, images: Images, intensities: np.ndarray):
        self.images, self.intensities, self.shape = images, intensities / intensities.mean(), images.shape

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of one picture."""
        return window_of(self.images, j, rows, columns) / np.float32(self.intensities[j])

    def saturated(self, j: int, rows: slice, columns: slice) -> Bool[np.ndarray, "h w c"] | None:
        """Where the pictures themselves say so."""
        return saturated_in(self.images, j, rows, columns)

    def __getitem__(self, j: int, /) -> Image:
        return self.window(j, slice(None), slice(None))
