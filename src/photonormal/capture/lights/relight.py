"""RelightLab's domes (`.dome`), and its projects (`.relight`), which hold one.

    {"imageWidth": 210.0, "domeDiameter": 600.0, "directions": [{"x": 0.3, "y": 0, "z": 0.9}, ...], "positions3d": []}

Lengths are in millimetres. Positions are read where there are no directions.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from photonormal.capture.lights.table import LightTable
from photonormal.stored import read_json
from photonormal.types import InputError

MOST = 100_000  # lights of a file

Vector = dict[str, Any] | list[Any]
Vectors = Annotated[list[Vector], Meta(max_length=MOST)]


class Dome(msgspec.Struct):
    """What is read of a dome; all lengths are in mm."""

    imageWidth: float = 0
    domeDiameter: float = 0
    directions: Vectors = []
    positions3d: Vectors = []
    positionsSphere: Vectors = []


class Photograph(msgspec.Struct):
    """One of a project's photographs."""

    filename: str = ""
    skip: bool = False


class Project(Dome):
    """A project, or a dome by itself."""

    dome: Dome | None = None
    images: Annotated[list[Photograph], Meta(max_length=MOST)] = []


def read(path: Path) -> LightTable:
    """Directions of the lights, of a project beside the names of its photographs."""
    project = read_json(path, Project, "export the dome from RelightLab again")
    dome = project.dome or project
    lights = dome.directions or dome.positions3d or dome.positionsSphere
    if not lights:
        raise InputError(f"{path} holds no directions or positions of lights; calibrate the dome in RelightLab first.")
    numbers = np.array([vector(v, path) for v in lights])
    names = [p.filename for p in project.images if not p.skip and p.filename]
    notes = []
    if dome.directions and dome.domeDiameter > 0 and dome.imageWidth > 0:
        notes.append(
            f"{path.name} speaks of lamps {dome.domeDiameter / 2:g} mm away and pictures {dome.imageWidth:g} mm wide: "
            f"for near lights add --dome-radius-mm {dome.domeDiameter / 2:g}, and --mm-per-px with that width divided "
            "by the pictures' width in pixels."
        )
    return LightTable(names if len(names) == len(numbers) else [], numbers, ("x", "y", "z"), notes=tuple(notes))


def vector(value: Vector, path: Path) -> list[float]:
    """x, y, z of an object or a list in JSON; numbers may be text."""
    try:
        x, y, z = (value[axis] for axis in "xyz") if isinstance(value, dict) else value
        return [float(x), float(y), float(z)]
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path} has {str(value)[:60]} where x, y, z of a light are needed; correct it.") from None
