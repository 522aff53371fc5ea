"""Names in a list of lights -> the pictures that they mean: of other machines, other letters' case, other formats."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from photonormal.capture.lights.table import Listed
from photonormal.capture.texts import beside, spellings
from photonormal.files.decode import SUFFIXES
from photonormal.types import InputError, a_few

KEYS: tuple[Callable[[str], str], ...] = (  # what has to agree: all, all but case, all but case and the extension
    str,
    str.casefold,
    lambda name: stem(name).casefold(),
)

SHOWN = 8  # names in a message


def in_order_of(pictures: Sequence[str], listed: Listed) -> tuple[list[int], list[int], list[str]]:
    """Which pictures have lights, which rows of the list those are, and what the user should know.

    Pictures are matched by name. A list that names none of them goes by order: it was made with other pictures under
    the same lights, such as those of a mirror sphere. A list that names only some chooses those.

    Raises
    ------
    InputError
        If a picture has no light, and the list names one that is not there, or one picture is meant twice.
    """
    everything, all_rows = list(range(len(pictures))), list(range(len(listed.vectors)))
    if not listed.names:
        return everything, all_rows, []
    find = finder(pictures)
    rows: dict[int, int] = {}  # picture -> row of the list
    absent = []
    for k, name in enumerate(listed.names):
        j = find(name)
        if j is None:
            absent.append(name)
        elif rows.setdefault(j, k) != k:
            raise InputError(
                f"{listed.path} has two lights for {pictures[j]}, by the names {listed.names[rows[j]]} and {name}, but "
                "a picture has one; remove the wrong line."
            )
    if not rows:
        note = (
            f"The list{listed.source} names other pictures ({last_part(listed.names[0])}, ...), not {pictures[0]}: "
            "its lights are taken in the pictures' order."
        )
        return everything, all_rows, [note]
    without = [pictures[j] for j in everything if j not in rows]
    if without and absent:
        raise InputError(
            f"{listed.path} has no light for {without[0]} but for other pictures of the capture, and one for "
            f"{last_part(absent[0])}, which is not there; correct the list or remove that picture."
        )
    chosen = sorted(rows)
    return chosen, [rows[j] for j in chosen], left_out(without, listed)


def left_out(pictures: Sequence[str], listed: Listed) -> list[str]:
    """What the user should know of pictures that a list does not name."""
    if not pictures:
        return []
    return [f"Left out, since the list{listed.source} has no light for them: {a_few(pictures, SHOWN)}."]


def finder(names: Sequence[str]) -> Callable[[str], int | None]:
    """From a name in a list to which of `names` it means; None: none of them, or more than one."""
    levels: list[dict[str, int | None]] = []
    for key in KEYS:
        seen: dict[str, int | None] = {}
        for j, name in enumerate(names):
            seen[key(name)] = None if key(name) in seen else j
        levels.append(seen)

    def find(name: str) -> int | None:
        for spelt in map(last_part, spellings(name)):
            for key, seen in zip(KEYS, levels, strict=True):
                if key(spelt) in seen:
                    return seen[key(spelt)]
        return None

    return find


def located(names: Sequence[str], folder: Path, pictures: Sequence[Path]) -> list[Path]:
    """The files that a list in `folder` names, where none is found the one that should be beside it.

    Names are paths from there, whichever system's slashes they have, or they come from another machine: then their last
    folder lies in or beside `folder`, or the file itself is one of the `pictures`.
    """
    find = finder([p.name for p in pictures])
    places = []
    for name in names:
        parts = [part for part in re.split(r"[\\/]", name) if part not in ("", ".")]
        tail = Path(*parts[-2:]) if len(parts) > 1 and ".." not in parts[-2:] else None
        tried = [beside(folder, name), beside(folder, name.replace("\\", "/"))]
        tried += [root / tail for root in (folder, folder.parent)] if tail else []
        tried += [beside(folder, last_part(name))]
        j = find(name)
        found = next((p for p in tried if os.path.isfile(p)), None)
        places.append(found or (pictures[j] if j is not None else tried[-1]))
    return places


def last_part(name: str) -> str:
    """The file's name at the end of a path of any operating system."""
    return re.split(r"[\\/]", name)[-1]


def stem(name: str) -> str:
    """A picture's name without the extension, if it has one."""
    base, dot, suffix = name.rpartition(".")
    return base if dot and f".{suffix.lower()}" in SUFFIXES else name
