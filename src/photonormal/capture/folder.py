"""A plain folder of photographs.

    my-object/
        any names, any picture format      in natural order: image 10 comes after image 9
        light_directions.txt               n x 3 or 3 x n; or lights.csv: [name,] x, y, z with or without a header
        light_intensities.txt              n x 1 or n x 3; optional
        filenames.txt                      the pictures in the order of the lights; optional
        mask.*                             white on the object; optional
        Normal_gt.mat                      true normals; optional
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from photonormal.capture.assemble import Choice, assemble, find_mask, pictures
from photonormal.capture.diligent import read_mat
from photonormal.capture.texts import number, read_directions, read_intensities, read_lines
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for any folder: it is the last reader asked."""
    return path.is_dir()


def read(path: Path, choice: Choice) -> Capture:
    """Pictures of the folder with the lights that lie beside them, or `choice.lights`."""
    if not path.is_dir():
        raise InputError(f"{path} is a file but a folder of pictures is needed; give the folder.")
    paths = [path / n for n in read_lines(path / "filenames.txt")] if (path / "filenames.txt").exists() else pictures(path)
    if not paths:
        raise InputError(f"{path} holds no pictures; give a folder with PNG, TIFF, JPEG, EXR, NPY or RAW files.")
    lights = None
    if choice.lights is None:
        if (path / "light_directions.txt").exists():
            lights = read_directions(path / "light_directions.txt")
        elif (path / "lights.csv").exists():
            paths, lights = read_csv(path / "lights.csv", paths)
        else:
            raise InputError(
                f"{path} has {len(paths)} pictures but no light_directions.txt, lights.csv or .lp; "
                "add one, or name a file with --lights."
            )
    intensities = path / "light_intensities.txt"
    truth = path / "Normal_gt.mat"
    return assemble(
        name=path.resolve().name,
        paths=paths,
        lights=lights,
        intensities=read_intensities(intensities, len(paths)) if intensities.exists() else None,
        mask=find_mask(path) if choice.mask is None else None,
        truth=read_mat(truth) if truth.exists() else None,
        choice=choice,
    )


def read_csv(path: Path, paths: list[Path]) -> tuple[list[Path], np.ndarray]:
    """Pictures and their light directions: rows `x, y, z` in the pictures' order, or `name, x, y, z` in any order."""
    names, directions = [], []
    for k, line in enumerate(read_lines(path)):
        cells = [c.strip().strip('"') for c in re.split(r"[;\t]" if re.search(r"[;\t]", line) else ",", line)]
        try:
            directions.append([number(c) for c in cells[-3:]])
        except ValueError:
            if k == 0:
                continue  # a header
            raise InputError(f"line {k + 1} of {path} is {line[:60]!r} but [name,] x, y, z is needed.") from None
        if len(cells) not in (3, 4):
            raise InputError(f"line {k + 1} of {path} has {len(cells)} cells but [name,] x, y, z is needed.")
        names.append(cells[0] if len(cells) == 4 else "")
    if directions and all(names):
        paths = [path.parent / name for name in names]
    return paths, np.array(directions).reshape(-1, 3)
