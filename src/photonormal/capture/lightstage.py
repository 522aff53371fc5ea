"""One object of the Light Stage Data Gallery (Einarsson et al., EGSR 2006).

    light_directions.txt            `index x y z` a line: the way the light travels
    light_intensities.txt           `index r g b` a line, in the same order
    helmet_side/                    the capture
        helmet_side_0001.png ...    8-bit, one for each light
        helmet_side_matte.png       black on the object

Lights from behind the object (z of the direction to the light at most 0.1) are left out, as others do who use this
set; a subset by numbers counts those that are left.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from photonormal.capture.assemble import Choice, assemble
from photonormal.capture.pictures import natural
from photonormal.capture.texts import positive, read_lines, read_named
from photonormal.files.decode import SUFFIXES, decode, full_scale
from photonormal.types import Capture, InputError

FRONT = 0.1  # least z of a light that is used


def matches(path: Path) -> bool:
    """True for an object's folder with a matte, beside the stage's light files."""
    return path.is_dir() and bool(list(path.glob("*_matte.*"))) and (path.parent / "light_directions.txt").is_file()


def read(path: Path, choice: Choice) -> Capture:
    """The object's pictures under the lights in front of it."""
    mattes = list(path.glob("*_matte.*"))
    if len(mattes) != 1:
        raise InputError(f"{path} has {len(mattes)} mattes but one `*_matte.png` is needed; it is black on the object.")
    matte = decode(mattes[0])
    paths = sorted((p for p in path.iterdir() if p not in mattes and _numbered(p)), key=lambda p: natural(p.name))
    stage = path.resolve().parent
    lights = -_without_index(stage / "light_directions.txt")
    intensities = positive(_without_index(stage / "light_intensities.txt"), stage / "light_intensities.txt")
    if not len(paths) == len(lights) == len(intensities):
        raise InputError(
            f"{path} has {len(paths)} pictures for {len(lights)} light directions and {len(intensities)} intensities; "
            "one of each is needed for every picture."
        )
    front = np.flatnonzero(lights[:, 2] > FRONT)
    return assemble(
        name=path.resolve().name,
        pictures=[paths[j] for j in front],
        lights=lights[front],
        intensities=intensities[front],
        mask=matte.max(-1) < 0.5 * full_scale(matte),
        choice=choice,
    )


def _numbered(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and re.search(r"\d", path.stem) is not None


def _without_index(path: Path) -> np.ndarray:
    return read_named(read_lines(path), path)[1]
