"""What a file of lights holds -> vectors to the lights: columns, rows, row numbers, angles."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from photonormal.types import InputError

AS = ("directions", "angles", "azimuth-elevation")  # what numbers may be; angles: slant and tilt, unless a header says
ANGLES = {  # what headers call two angles in degrees
    "angles": (r"slants?|polar|zenith|colatitude", r"tilts?"),
    "azimuth-elevation": (r"azimuth?s?|az", r"elevations?|ele?v?|altitudes?|alt"),
}
AXES = ("x", "y", "z")
UNEQUAL = 4.0  # times the shortest vector: longer ones are hardly directions
RADIANS = 2 * np.pi  # angles none of which exceeds it are no degrees


@dataclass(frozen=True)
class LightTable:
    """A file's numbers.

    Parameters
    ----------
    names : what the rows are called, which may be numbers; empty: nothing
    numbers : (n, k)
    columns : what the k columns are called, where there is a header
    intensities : (n, 1 or 3), where the file has them
    notes : what the user should know, a sentence each
    """

    names: list[str]
    numbers: np.ndarray
    columns: tuple[str, ...] = ()
    intensities: np.ndarray | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Listed:
    """Lights of a file: names of pictures, none where it names none, vectors (n, 3), and as in `LightTable` what else.

    `path` is None where they come from no file.
    """

    path: Path | None
    names: list[str]
    vectors: np.ndarray
    intensities: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    @property
    def source(self) -> str:
        """Where they stand, as the end of a phrase."""
        return "" if self.path is None else f" in {self.path.name}"


def vectors(table: LightTable, lights_as: str, path: Path) -> Listed:
    """The vectors that a table holds, by its header, or else by what the user says that it holds."""
    names, numbers, notes = table.names, table.numbers, list(table.notes)
    kind = lights_as or next((k for k, words in ANGLES.items() if _columns(table, words)), "directions")
    if not table.columns and not names and _row_numbers(numbers[:, 0]) and numbers.shape[1] == _width(kind) + 1:
        numbers = numbers[:, 1:]
    if kind != "directions":
        which = next((k for k, words in ANGLES.items() if _columns(table, words)), kind)
        found = _from_angles(_chosen(table, numbers, ANGLES[which], path), which, path)
        if not table.columns:
            order = (
                "azimuth from x towards y, elevation" if which != "angles" else "slant from z, tilt from x towards y"
            )
            notes.append(f"{path.name} is taken for angles in degrees: {order}.")
    else:
        found = _chosen(table, numbers, AXES, path)
        notes += _doubts(found, path)
    if names and _row_numbers(names):  # they count rows, in the pictures' order
        names = []
    elif not names and path.suffix.lower() == ".lp":
        notes.append(f"{path.name} names no pictures: its lights are taken in the pictures' order.")
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise InputError(f"{path} names {name} twice but a picture has one light; remove the wrong line.")
        seen.add(name)
    return Listed(path, names, found, table.intensities, tuple(notes))


def _chosen(table: LightTable, numbers: np.ndarray, words: tuple[str, ...], path: Path) -> np.ndarray:
    """The columns that the words say; without a header the first ones."""
    k = len(words)
    found = _columns(table, words)
    if found:
        return numbers[:, found]
    if numbers.shape[1] == k or (numbers.shape[1] > k and table.names):
        return numbers[:, :k]
    if numbers.shape[0] == k and k == 3:
        return numbers.T
    if numbers.shape[1] == 2:
        raise InputError(
            f"{path} has two numbers for each light but x, y, z are needed; if they are slant and tilt in degrees, add "
            "--lights-as angles, or --lights-as azimuth-elevation."
        )
    needed = "(n, 3) or (3, n) directions" if k == 3 else f"(n, {k}) angles"
    raise InputError(
        f"{path} is a table of {numbers.shape} but {needed} are needed; name its columns in a first line, such as "
        f"{' '.join(words) if k == 3 else 'slant tilt'}."
    )


def _columns(table: LightTable, words: tuple[str, ...]) -> list[int]:
    """Which columns the header calls so; empty unless it has one for each word."""
    found = []
    for word in words:
        pattern = re.compile(rf"(^|[^a-z])(light|dir|direction|l|n)?({word})([^a-z]|$)", re.IGNORECASE)
        found.append([k for k, name in enumerate(table.columns) if pattern.search(name)])
    return [f[0] for f in found] if all(found) else []


def _width(kind: str) -> int:
    return 3 if kind == "directions" else 2


def _row_numbers(values: np.ndarray | list[str]) -> bool:
    """Whether values count 0, 1, 2, ... or 1, 2, 3, ..."""
    try:
        counted = [float(v) for v in values]
    except ValueError:
        return False
    return len(counted) > 1 and counted[0] in (0, 1) and all(b - a == 1 for a, b in pairwise(counted))


def _from_angles(angles: np.ndarray, kind: str, path: Path) -> np.ndarray:
    """Unit vectors from slant and tilt, or azimuth and elevation, (n, 2) in degrees."""
    if np.abs(angles).max() <= RADIANS:
        raise InputError(
            f"{path} has angles up to {np.abs(angles).max():.3g} but degrees are needed, and these look like radians; "
            "multiply them by 57.29578."
        )
    if kind == "angles":
        slant, tilt = np.radians(angles.T)
    else:
        slant, tilt = np.pi / 2 - np.radians(angles[:, 1]), np.radians(angles[:, 0])
    return np.stack([np.sin(slant) * np.cos(tilt), np.sin(slant) * np.sin(tilt), np.cos(slant)], axis=-1)


def _doubts(v: np.ndarray, path: Path) -> list[str]:
    """What speaks against directions: row numbers and two angles are refused, lengths that differ much get a remark."""
    if len(v) > 2 and _row_numbers(v[:, 0]) and np.abs(v[:, 1:]).max() > 2:
        raise InputError(
            f"{path} counts its rows and has two more numbers, such as {v[0, 1]:g} and {v[0, 2]:g}, but x, y, z are "
            "needed; if they are slant and tilt in degrees, add --lights-as angles, or --lights-as azimuth-elevation."
        )
    with np.errstate(all="ignore"):
        length = np.linalg.norm(v, axis=1)
    if not np.isfinite(length).all() or length.min() <= 0 or length.max() <= UNEQUAL * length.min():
        return []
    return [
        f"{path.name} has vectors from {length.min():.3g} to {length.max():.3g} long: if they are angles, say so with "
        "--lights-as; if positions in mm, add --mm-per-px."
    ]
