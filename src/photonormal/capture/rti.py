"""RTI captures: an `.lp` file (`photonormal.capture.lights`) and the pictures that it names; RTIBuilder's projects.

project/
    jpeg-exports/, cropped-files/, ...      the pictures
    assembly-files/project.lp               their lights, by names of the machine that made them

Names may hold spaces and are taken relative to the `.lp`, or by their last parts where they come from another machine.
"""

from __future__ import annotations

import os
from pathlib import Path

from photonormal.capture import folder
from photonormal.capture.assemble import Choice
from photonormal.capture.lights import read_lights
from photonormal.capture.lights.match import located
from photonormal.capture.pictures import picture_files, pictures_below
from photonormal.types import Capture, InputError

ASSEMBLY = "assembly-files"  # the folder of a project that holds the lists
ORIGINAL = "_originalset"  # ends the name of RTIBuilder's list of pictures before they were cropped


def matches(path: Path) -> bool:
    """True for an `.lp` file, for a folder that holds one, and for a project."""
    return path.suffix.lower() == ".lp" if path.is_file() else bool(_lp_files(path) or _of_project(path))


def read(path: Path, choice: Choice) -> Capture:
    """The pictures that an `.lp` file names, with its directions, or with the lights that the user names."""
    if path.is_file():
        return _read(path, choice)
    if picture_files(path) and _lp_files(path):
        return folder.read(path, choice)
    lists = _lp_files(path) or _of_project(path)
    if not lists:
        raise InputError(f"{path} has 0 .lp files but one is needed; name the file itself, or add --lights.")
    return _read(_chosen(lists, path), choice, path)


def _read(lp: Path, choice: Choice, path: Path | None = None) -> Capture:
    """The pictures of a list, as the capture of a folder: its project's, where it lies in one."""
    place = lp.resolve().parent
    of_project = place.name.lower() == ASSEMBLY and not picture_files(place)
    return folder.read(place.parent if of_project else path or lp.parent, choice, lights=lp)


def named_pictures(path: Path) -> list[Path]:
    """The files that an `.lp` file names, or the one in a folder or project; none where there is no list."""
    lists = [path] if path.is_file() else _lp_files(path) or _of_project(path)
    if not lists:
        return []
    lp = _chosen(lists, path)
    named = located(read_lights(lp).names, lp.parent, pictures_below(lp.parent))
    return [picture for picture in named if os.path.isfile(picture)]


def _lp_files(path: Path) -> list[Path]:
    return sorted(p for p in path.iterdir() if p.suffix.lower() == ".lp" and not p.is_dir())


def _of_project(path: Path) -> list[Path]:
    """The lists in the folders of a project, which holds no pictures itself."""
    if picture_files(path):
        return []
    below = [p for p in sorted(path.iterdir()) if p.is_dir() and os.access(p, os.R_OK | os.X_OK)]
    return [lp for p in below for lp in _lp_files(p)]


def _chosen(lists: list[Path], path: Path) -> Path:
    """The list whose pictures are there; of those the one of what was made of the original set."""
    there = [p for p in lists if any(map(os.path.isfile, located(read_lights(p).names, p.parent, [])))] or lists
    made = [p for p in there if not p.stem.lower().endswith(ORIGINAL)] or there
    if len(made) > 1:
        all_of_them = f", or give all folders to `photonormal batch '{path}/*'`"
        raise InputError(
            f"{path} has {len(made)} .lp files ({', '.join(str(p.relative_to(path)) for p in made)}) but one is "
            f"needed; name the file itself{all_of_them if len({p.parent for p in made}) == len(made) else ''}."
        )
    return made[0]
