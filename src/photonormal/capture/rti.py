"""RTI captures: an `.lp` file (`photonormal.capture.lights`) and the pictures that it names.

Names may hold spaces and are taken relative to the `.lp`, or by their last part where they come from another machine.
"""

from __future__ import annotations

import os
from pathlib import Path

from photonormal.capture.assemble import Choice, assemble, find_mask
from photonormal.capture.lights import last_part, read_lp
from photonormal.capture.texts import beside
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
        pictures=[_find(path, name) for name in names],
        lights=lights,
        mask=find_mask(path.parent) if choice.mask is None else None,
        choice=choice,
    )


def _lp_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.suffix.lower() == ".lp" and not p.is_dir())


def _find(lp: Path, name: str) -> Path:
    """The picture that a line names: as written, with the other system's slashes, or by its last part."""
    candidates = [beside(lp.parent, n) for n in (name, name.replace("\\", "/"), last_part(name))]
    return next((c for c in candidates if os.path.isfile(c)), candidates[-1])
