"""RTI light position files (`.lp`): a count, then a picture's name and its light's direction in each line.

    3
    DSC 0001.jpg 0.34 -0.20 0.92
    ...

Names may hold spaces and are taken relative to the `.lp`, or by their last part where they come from another machine.
Vectors need not be unit; numbers may have decimal commas. Frame: x right, y up, z to the camera.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from photonormal.capture.assemble import Choice, assemble, find_mask
from photonormal.capture.texts import number, read_lines
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for an `.lp` file, and for a folder that holds one."""
    return path.suffix.lower() == ".lp" if path.is_file() else bool(_lp_files(path))


def read(path: Path, choice: Choice) -> Capture:
    """The pictures that an `.lp` file names, with its directions; the mask is the folder's `mask.*`, if any."""
    if path.is_dir():
        found = _lp_files(path)
        if len(found) != 1:
            raise InputError(f"{path} has {len(found)} .lp files but one is needed; name the file itself.")
        path = found[0]
    names, lights = read_lp(path)
    return assemble(
        name=path.stem,
        paths=[_find(path, name) for name in names],
        lights=lights,
        mask=find_mask(path.parent) if choice.mask is None else None,
        choice=choice,
    )


def read_lp(path: Path) -> tuple[list[str], np.ndarray]:
    """Picture names and directions (n, 3) as written."""
    lines = read_lines(path)
    try:
        count = int(lines[0])
    except (ValueError, IndexError):
        raise InputError(
            f"{path} begins with {lines[0][:40] if lines else ''!r} but an .lp file begins with its number of pictures."
        ) from None
    names, directions = [], []
    for k, line in enumerate(lines[1:]):
        cells = line.rsplit(maxsplit=3)
        try:
            directions.append([number(c) for c in cells[1:]])
            names.append(cells[0].strip('"'))
            if len(cells) != 4:
                raise ValueError
        except ValueError:
            raise InputError(f"line {k + 2} of {path} is {line[:60]!r} but `name x y z` is needed; correct it.") from None
    if count != len(names):
        raise InputError(f"{path} says {count} pictures but lists {len(names)}; correct its first line or the list.")
    return names, np.array(directions).reshape(-1, 3)


def _lp_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix.lower() == ".lp" and p.is_file())


def _find(lp: Path, name: str) -> Path:
    """The picture that a line names: as written, or by its last part in the `.lp`'s folder."""
    here = lp.parent / name
    return here if here.exists() else lp.parent / re.split(r"[\\/]", name)[-1]
