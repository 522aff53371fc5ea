"""One sample of the Blobby and Sculpture training sets (Chen et al., ECCV 2018).

Images/<shape>/
    <shape>_normal.png                     8-bit, n = 2 v / 255 - 1, background 127
    <material>/                            the capture
        <shape>_<material>.txt             `picture lx ly lz` a line
        64 pictures, 8-bit linear, lights of intensity 1
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from photonormal.capture.assemble import Choice, assemble, coded_normals
from photonormal.capture.lights.match import last_part
from photonormal.capture.texts import read_lines, read_named
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for a material's folder inside a shape's folder."""
    return os.path.isfile(_list(path)) and os.path.isfile(normal_map(path))


def read(path: Path, choice: Choice) -> Capture:
    """The sample in a material's folder; its mask is where the normal map holds a normal."""
    names, lights = listed(path)
    truth = coded_normals(normal_map(path))
    if truth.shape[-1] != 3:
        raise InputError(f"{normal_map(path)} is grey but normals have three channels; restore it.")
    length = np.linalg.norm(truth, axis=-1, keepdims=True)
    truth = np.where(length > 0.1, truth / length.clip(1e-6), 0)  # background is 127, which is -0.004
    return assemble(
        name=f"{path.resolve().parent.name}/{path.resolve().name}",
        pictures=[path / n for n in names],
        lights=lights,
        mask=np.linalg.norm(truth, axis=-1) > 0.5,
        truth=truth,
        choice=choice,
    )


def listed(path: Path) -> tuple[list[str], np.ndarray]:
    """The pictures in a sample's folder that its list names, and their lights (n, 3) as written."""
    names, lights = read_named(read_lines(_list(path)), _list(path))
    if longer := [n for n in names if re.search(r"\S\s+[-+\d.,e]+$", n)]:
        raise InputError(
            f"{_list(path)} has more than `picture x y z` after {longer[0].split()[0]}; leave the rest out."
        )
    return [last_part(n) for n in names], lights


def keys(file: Path) -> list[str]:
    """What a list of samples names, `shape/material` each, also where Windows wrote it."""
    return [line.replace("\\", "/") for line in read_lines(file)]


def listed_samples(root: Path) -> list[Path]:
    """The sample folders that `train_mtrl.txt` or `val_mtrl.txt` of a set's root, or the file given, lists."""
    lists = [root] if root.is_file() else [p for p in (root / "train_mtrl.txt", root / "val_mtrl.txt") if p.exists()]
    if not lists:
        raise InputError(f"{root} has no train_mtrl.txt or val_mtrl.txt; give the root of a Blobby or Sculpture set.")
    return [file.parent / "Images" / key for file in lists for key in keys(file)]


def _list(path: Path) -> Path:
    path = path.resolve()
    return path / f"{path.parent.name}_{path.name}.txt"


def normal_map(path: Path) -> Path:
    """The picture with the normals of a sample's shape."""
    shape = path.resolve().parent
    return shape / f"{shape.name}_normal.png"
