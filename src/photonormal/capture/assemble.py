"""The last step of every reader: picture files, lights and a mask become one Capture."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.capture.images import SUFFIXES, ImageFiles, read_mask
from photonormal.types import Capture, InputError, Normals, unit_lights


@dataclass(frozen=True)
class Choice:
    """What a user may say about a capture beyond its folder.

    Parameters
    ----------
    images : a subset by 1-based numbers, "1-10,15"; empty: all
    lights : file with light directions, instead of the folder's own; `.lp` or a table
    mask : mask picture, instead of the folder's own
    srgb : the pictures are sRGB-encoded and have to be linearised
    """

    images: str = ""
    lights: Path | None = None
    mask: Path | None = None
    srgb: bool = False


def assemble(
    name: str,
    paths: Sequence[Path],
    lights: np.ndarray | None,
    choice: Choice,
    intensities: np.ndarray | None = None,
    mask: Path | np.ndarray | None = None,
    truth: np.ndarray | None = None,
) -> Capture:
    """A Capture of the chosen pictures.

    `lights` is (n, 3) for the n `paths`, `intensities` (n, 1 or 3) or None (all 1), `truth` (h, w, 3) with zero or NaN
    where unknown.
    """
    n = len(paths)
    if not n:
        raise InputError(f"{name} holds no pictures; give a folder with PNG, TIFF, JPEG, EXR, NPY or RAW files.")
    if choice.lights is not None:
        lights = read_lights(choice.lights)
    if lights is not None and len(lights) != n:
        raise InputError(
            f"{name} has {n} pictures but {len(lights)} light directions; give one direction for each picture, "
            "in the same order, and remove pictures that are not part of the capture."
        )
    if lights is not None:
        lights = unit_lights(lights, n)
    if intensities is None:
        intensities = np.ones((n, 1))
    if choice.mask is not None:
        mask = choice.mask
    chosen = parse_images(choice.images, n)
    if isinstance(mask, Path):
        mask = read_mask(mask)
    files = ImageFiles([paths[j] for j in chosen], mask, intensities[chosen], choice.srgb)
    frame = files.shape[1:3]
    return Capture(
        images=files,
        mask=np.ones(frame, bool) if mask is None else mask,
        lights=None if lights is None else lights[chosen],
        truth=None if truth is None else known_normals(truth),
        saturation=files.saturation,
        name=name,
        image_names=tuple(paths[j].name for j in chosen),
    )


def known_normals(map: np.ndarray) -> Normals:
    """Normals whose mask is where the given map (h, w, 3) has vectors of about unit length."""
    length = np.linalg.norm(map, axis=-1)
    known = np.abs(length - 1) < 0.1  # 8-bit maps are off by a few per cent; background codes are near 0
    unit = np.zeros(map.shape, np.float32)
    unit[known] = map[known] / length[known][:, None]
    return Normals(unit, known)


def read_lights(path: Path) -> np.ndarray:
    """Light directions (n, 3) from an `.lp` file or a table of numbers."""
    if path.suffix.lower() == ".lp":
        from photonormal.capture.rti import read_lp

        return read_lp(path)[1]
    from photonormal.capture.texts import read_directions

    return read_directions(path)


def parse_images(text: str, n: int) -> list[int]:
    """Zero-based indices from 1-based numbers and ranges.

    >>> parse_images("1-3,5", 6)
    [0, 1, 2, 4]
    """
    if not text.strip():
        return list(range(n))
    chosen: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
        if match is None:
            raise InputError(f"images {text!r} has {part!r} but numbers and ranges like 1-10,15 are needed.")
        first, last = int(match[1]), int(match[2] or match[1])
        if not 1 <= first <= last <= n:
            raise InputError(f"images {text!r} asks for {part.strip()} but this capture has 1 to {n}; choose from those.")
        chosen += range(first - 1, last)
    if len(set(chosen)) != len(chosen):
        raise InputError(f"images {text!r} names a picture twice; name each once.")
    return chosen


def natural(path: Path) -> list[tuple[int, str]]:
    """Sorting key that puts image 10 after image 9."""
    return [(int(t), "") if t.isdigit() else (-1, t.lower()) for t in re.split(r"(\d+)", path.name) if t]


def pictures(folder: Path) -> list[Path]:
    """Picture files of a folder in natural order, without masks, normals and previews."""
    other = re.compile(r"(^|[._-])(mask|matte|normals?|normal_gt|normals?_gt|inboundary|onboundary)$", re.IGNORECASE)
    found = (p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith("."))
    return sorted((p for p in found if p.is_file() and not other.search(p.stem)), key=natural)


def find_mask(folder: Path) -> Path | None:
    """The folder's mask picture: `mask.*`, or a name that ends in `.mask` or `_mask`."""
    masks = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and re.search(r"(^|[._-])mask$", p.stem, re.I)]
    if len(masks) > 1:
        raise InputError(f"{folder} has {len(masks)} masks ({', '.join(p.name for p in masks)}); choose one with --mask.")
    return masks[0] if masks else None
