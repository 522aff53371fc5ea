"""AliceVision's lights (`.json`): ``{"lights": [{"direction": [x, y, z], "intensity": [r, g, b]}, ...]}``.

Its own frame has y down and z away from the camera: --frame y-down.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from photonormal.capture.lights.relight import MOST, vector
from photonormal.capture.lights.table import Table
from photonormal.capture.texts import positive
from photonormal.stored import read_json
from photonormal.types import InputError


class Light(msgspec.Struct):
    """One light; numbers may be text."""

    direction: list[Any]
    intensity: list[Any] | float | str | None = None


class Lights(msgspec.Struct):
    """The file."""

    lights: Annotated[list[Light], Meta(min_length=1, max_length=MOST)]


def read(path: Path) -> Table:
    """Directions, and intensities where all lights tell theirs."""
    lights = read_json(path, Lights, "a list of lights with directions is needed").lights
    numbers = np.array([vector(light.direction, path) for light in lights])
    found = [light.intensity for light in lights]
    intensities = None
    if all(v is not None for v in found):
        try:
            intensities = np.array([v if isinstance(v, list) else [v] for v in found], dtype=float)
        except ValueError:
            intensities = np.zeros(0)
        if intensities.shape not in ((len(lights), 1), (len(lights), 3)):
            raise InputError(f"{path} has intensities that are neither one number nor red, green, blue; correct it.")
        positive(intensities, path)
    return Table([], numbers, ("x", "y", "z"), intensities)
