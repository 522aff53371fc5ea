"""AliceVision's lights (`.json`).

    {"lights": [{"viewId": "17", "type": "directional", "direction": ["0.3", ...], "intensity": ["1", ...]}, ...]}

Others write `name`, the picture's, in place of `viewId`. AliceVision's own frame has y down and z away from the camera:
--frame y-down. It lists lights in the order of its views' numbers, which are made of the pictures' content.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from photonormal.capture.lights.relight import MOST, vector
from photonormal.capture.lights.table import LightTable
from photonormal.capture.texts import positive
from photonormal.stored import read_json
from photonormal.types import InputError

NEEDED = (
    '{"lights": [{"direction": [x, y, z]}, ...]} is needed, in the pictures\' order or each with a "name"; '
    "or save the lights as text, `name x y z` in each line"
)


class Light(msgspec.Struct):
    """One light; numbers may be text."""

    direction: list[Any]
    type: str = "directional"
    viewId: str | int | None = None
    name: str | None = None
    intensity: list[Any] | float | str | None = None


class LightsFile(msgspec.Struct):
    """The file."""

    lights: Annotated[list[Light], Meta(min_length=1, max_length=MOST)]


def read(path: Path) -> LightTable:
    """Directions, and intensities where all lights have theirs."""
    lights = read_json(path, LightsFile, NEEDED).lights
    if any(light.type != "directional" for light in lights):
        raise InputError(f"{path} holds lights of type {lights[0].type} but directional ones are needed; export those.")
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
    notes = ()
    if any(light.viewId is not None for light in lights):
        notes = (
            f"{path.name} has its lights in the order of AliceVision's views: see that the pictures have it, too.",
        )
    names = [light.name for light in lights if light.name]
    if names and len(names) < len(lights):
        raise InputError(
            f"{path} names {len(names)} of its {len(lights)} lights but all or none is needed; correct it."
        )
    return LightTable(names, numbers, ("x", "y", "z"), intensities, notes)
