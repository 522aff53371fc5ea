"""A plain folder of photographs.

my-object/
    any names, any picture format      in natural order: image 10 comes after image 9
    light_directions.txt               n x 3 or 3 x n; or lights.csv: [name,] x, y, z, header or not; names
                                       in it choose and order the pictures
    light_intensities.txt              n x 1 or n x 3; optional
    filenames.txt                      the pictures in the order of the lights; optional
    mask.*                             white on the object; optional
    Normal_gt.mat                      true normals; optional
"""

from __future__ import annotations

import os
from pathlib import Path

from photonormal.capture.assemble import Choice, assemble, find_mask, find_pictures
from photonormal.capture.diligent import read_normals
from photonormal.capture.lights import read_csv
from photonormal.capture.texts import beside, read_directions, read_intensities, read_lines
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for any folder: it is the last reader asked."""
    return path.is_dir()


def read(path: Path, choice: Choice) -> Capture:
    """Pictures of the folder with the lights that lie beside them, or `choice.lights`."""
    listed = path / "filenames.txt"
    pictures = [beside(path, n) for n in read_lines(listed)] if os.path.lexists(listed) else find_pictures(path)
    lights = None
    if not pictures or choice.lights is not None:
        pass
    elif os.path.lexists(path / "light_directions.txt"):
        lights = read_directions(path / "light_directions.txt")
    elif os.path.lexists(path / "lights.csv"):
        names, lights = read_csv(path / "lights.csv")
        pictures = [beside(path, n) for n in names] or pictures
    else:
        raise InputError(
            f"{path} has {len(pictures)} pictures but no light_directions.txt, lights.csv or .lp; "
            "add one, or name a file with --lights."
        )
    intensities = path / "light_intensities.txt"
    truth = path / "Normal_gt.mat"
    return assemble(
        name=path.resolve().name,
        pictures=pictures,
        lights=lights,
        intensities=read_intensities(intensities, len(pictures)) if os.path.lexists(intensities) else None,
        mask=find_mask(path) if choice.mask is None else None,
        truth=(lambda frame: read_normals(truth, frame)) if os.path.lexists(truth) else None,
        choice=choice,
    )
