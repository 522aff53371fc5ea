"""Files with light directions: `.lp` and CSV, which may name their pictures, and tables of numbers.

An `.lp` file is a count, then a picture's name and its light's direction in each line:

    3
    DSC 0001.jpg 0.34 -0.20 0.92
    ...

Vectors need not be unit and may have decimal commas. Frame: x right, y up, z to the camera. With a scale they are
positions in mm (`placed`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photonormal.capture.texts import number, read_directions, read_lines, read_named, spellings
from photonormal.types import Camera, InputError, Lamps


def read_lights(path: Path) -> tuple[list[str], np.ndarray]:
    """Picture names, none where the file has none, and directions (n, 3) as written."""
    suffix = path.suffix.lower()
    if suffix == ".lp":
        return read_lp(path)
    return read_csv(path) if suffix == ".csv" else ([], read_directions(path))


def read_lp(path: Path) -> tuple[list[str], np.ndarray]:
    """Picture names and directions (n, 3) of an `.lp` file."""
    lines = read_lines(path)
    count = lines[0] if lines else ""
    if not re.fullmatch(r"[0-9]{1,9}", count):
        raise InputError(f"{path} begins with {count[:40]!r} but its number of pictures is needed there; correct it.")
    names, lights = read_named(lines[1:], path, first=2)
    if int(count) != len(names):
        raise InputError(f"{path} says {count} pictures but lists {len(names)}; correct its first line or the list.")
    return names, lights


def read_csv(path: Path) -> tuple[list[str], np.ndarray]:
    """Picture names and directions (n, 3) of rows `x, y, z` or `name, x, y, z`; the first row may be a header."""
    names, lights = [], []
    for k, line in enumerate(read_lines(path)):
        separator = next((s for s in ("[;\t]", ",") if re.search(s, line)), r"\s+")
        cells = [c.strip().strip('"') for c in re.split(separator, line)]
        if k == 0 and not re.search(r"\d", "".join(cells[1:])):
            continue  # a header
        try:
            lights.append([number(c) for c in cells[-3:]])
            names += cells[:-3]
            if len(cells) < 3 or len(names) not in (0, len(lights)):
                raise ValueError
        except ValueError:
            raise InputError(
                f"line {k + 1} of {path} is {line[:60]!r} but x, y, z or name, x, y, z is needed, "
                "the same in every line; correct it."
            ) from None
    return names, np.array(lights).reshape(-1, 3)


def in_order_of(pictures: Sequence[str], names: list[str], lights: np.ndarray, path: Path) -> np.ndarray:
    """Directions (n, 3) in the order of the `pictures`, by name.

    They stay in the file's own order where it names none of them: they were made with other pictures under the same
    lights, such as those of a mirror sphere.
    """
    row = {last_part(spelt): k for k, name in enumerate(names) for spelt in spellings(name)}
    absent = [p for p in pictures if p not in row]
    if len(absent) == len(pictures):
        return lights
    if absent:
        raise InputError(
            f"{path} has no light for {absent[0]} but for other pictures of the capture; add it or remove that picture."
        )
    return lights[[row[p] for p in pictures]]


def placed(
    lights: np.ndarray | None,
    mm_per_px: float | None,
    dome_radius_mm: float | None,
    focal_px: float | None,
    shape: tuple[int, int],
) -> tuple[Lamps | None, Camera | None]:
    """Lamps and camera of pictures of a `shape` (rows, columns), as `assemble.Choice` says; None: lights are distant.

    Positions count from the camera where a focal length is given, else from the middle of the picture.
    """
    if mm_per_px is None:
        for option, value in (("--dome-radius-mm", dome_radius_mm), ("--focal-px", focal_px)):
            if value is not None:
                raise InputError(
                    f"{option} {value:g} came without --mm-per-px but near lights need the scale; add how many "
                    "millimetres a pixel is wide on the object."
                )
        return None, None
    for option, value in (("--dome-radius-mm", dome_radius_mm), ("--focal-px", focal_px)):
        if value is not None and not 0 < value < np.inf:
            raise InputError(f"{option} is {value:g} but a length above 0 is needed; correct it.")
    if lights is None:
        raise InputError("--mm-per-px came but no lights; name a file with their positions in mm with --lights.")
    h, w = shape
    K = None if focal_px is None else np.array([[focal_px, 0, (w - 1) / 2], [0, focal_px, (h - 1) / 2], [0, 0, 1]])
    camera = Camera(mm_per_px, K)
    length = np.linalg.norm(lights, axis=1)
    if dome_radius_mm is not None:
        distance_mm = 0.0 if focal_px is None else focal_px * mm_per_px
        return Lamps(dome_radius_mm * lights / np.maximum(length, 1e-300)[:, None] - [0, 0, distance_mm]), camera
    if (np.abs(length - 1) < 0.02).all():
        raise InputError(
            "--mm-per-px came but the lights are unit vectors, while positions in mm are needed; give their distance "
            "with --dome-radius-mm, or leave --mm-per-px out."
        )
    return Lamps(lights), camera


def last_part(name: str) -> str:
    """The file's name at the end of a path of any operating system."""
    return re.split(r"[\\/]", name)[-1]
