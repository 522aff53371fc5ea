"""One sample of the Blobby and Sculpture training sets (Chen et al., ECCV 2018).

    Images/<shape>/
        <shape>_normal.png                     8-bit, n = 2 v / 255 - 1, background 127
        <material>/                            the capture
            <shape>_<material>.txt             `picture lx ly lz` a line
            64 pictures, 8-bit linear, lights of intensity 1
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photonormal.capture.assemble import Choice, assemble
from photonormal.capture.images import decode
from photonormal.capture.texts import number, read_lines
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for a material's folder inside a shape's folder."""
    return path.is_dir() and _list(path).is_file() and _normal(path).is_file()


def read(path: Path, choice: Choice) -> Capture:
    """The sample in a material's folder; its mask is where the normal map holds a normal."""
    names, lights = [], []
    for k, line in enumerate(read_lines(_list(path))):
        cells = line.rsplit(maxsplit=3)
        try:
            lights.append([number(c) for c in cells[1:]])
            names.append(cells[0])
            if len(cells) != 4:
                raise ValueError
        except ValueError:
            raise InputError(f"line {k + 1} of {_list(path)} is {line[:60]!r} but `picture lx ly lz` is needed.") from None
    if not _normal(path).exists():
        raise InputError(f"{_normal(path)} is missing; it holds the sample's normals and mask.")
    truth = decode(_normal(path)).astype(np.float64) / 255 * 2 - 1
    truth[(truth**2).sum(-1) < 0.01] = 0  # background is 127, which is -0.004
    truth /= np.linalg.norm(truth, axis=-1, keepdims=True).clip(1e-6)
    return assemble(
        name=f"{path.resolve().parent.name}/{path.resolve().name}",
        paths=[path / Path(n).name for n in names],
        lights=np.array(lights).reshape(-1, 3),
        mask=(truth**2).sum(-1) > 0.5,
        truth=truth,
        choice=choice,
    )


def samples(root: Path) -> list[Path]:
    """The sample folders that `train_mtrl.txt` or `val_mtrl.txt` of a set's root, or the file given, lists."""
    lists = [root] if root.is_file() else [p for p in (root / "train_mtrl.txt", root / "val_mtrl.txt") if p.exists()]
    if not lists:
        raise InputError(f"{root} has no train_mtrl.txt or val_mtrl.txt; give the root of a Blobby or Sculpture set.")
    return [file.parent / "Images" / line for file in lists for line in read_lines(file)]


def _list(path: Path) -> Path:
    path = path.resolve()
    return path / f"{path.parent.name}_{path.name}.txt"


def _normal(path: Path) -> Path:
    shape = path.resolve().parent
    return shape / f"{shape.name}_normal.png"
