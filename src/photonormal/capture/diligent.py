"""DiLiGenT objects (Shi et al., TPAMI 2019).

ballPNG/
    001.png .. 096.png          16-bit linear RGB, in the order of filenames.txt
    filenames.txt               one name a line
    light_directions.txt        96 x 3
    light_intensities.txt       96 x 3, red green blue; each channel is divided by it
    mask.png
    Normal_gt.mat               variable Normal_gt (h, w, 3); optional
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from photonormal.capture.assemble import Choice, assemble
from photonormal.capture.lights import read_lights
from photonormal.capture.texts import beside, read_lines
from photonormal.files.matlab import read_mat
from photonormal.types import Capture, InputError

NEEDED = ("filenames.txt", "light_directions.txt", "light_intensities.txt")


def matches(path: Path) -> bool:
    """True for an object's folder, and for a folder of objects, which `read` answers with their names."""
    return is_object(path) or bool(objects(path))


def objects(root: Path) -> list[Path]:
    """Object folders of the benchmark, given `DiLiGenT`, `DiLiGenT/pmsData` or any folder of objects."""
    for folder in (root / "pmsData", root):
        found = [p for p in sorted(folder.iterdir()) if is_object(p)] if os.path.isdir(folder) else []
        if found:
            return found
    return []


def read(path: Path, choice: Choice) -> Capture:
    """One object; a folder of objects is an error that lists them."""
    if not is_object(path) and (found := objects(path)):
        raise InputError(
            f"{path} holds {len(found)} objects but one is measured at a time; choose from "
            f"{', '.join(str(p) for p in found)}, or give all of them to `photonormal batch '{found[0].parent}/*'`."
        )
    names, truth = read_lines(path / "filenames.txt"), path / "Normal_gt.mat"
    return assemble(
        name=path.resolve().name.removesuffix("PNG"),
        pictures=[beside(path, name) for name in names],
        lights=read_lights(path / "light_directions.txt"),
        intensities=path / "light_intensities.txt",
        mask=path / "mask.png" if os.path.lexists(path / "mask.png") else None,
        truth=(lambda frame: read_normals(truth, frame)) if os.path.lexists(truth) else None,
        choice=choice,
    )


def read_normals(path: Path, frame: tuple[int, int]) -> np.ndarray:
    """The variable Normal_gt (h, w, 3) of a MATLAB file, for pictures of (h, w)."""
    return read_mat(path, "Normal_gt", (*frame, 3))


def is_object(folder: Path) -> bool:
    """True for one object's folder."""
    return all(os.path.isfile(folder / name) for name in NEEDED)
