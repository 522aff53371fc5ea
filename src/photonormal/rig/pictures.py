"""Which pictures of a folder are photographs of a rig, and what is read of all of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from photonormal.capture import rti
from photonormal.capture.images import ImageFiles
from photonormal.capture.pictures import find_mask, find_pictures, no_pictures
from photonormal.capture.texts import read_lines
from photonormal.resources import cores, in_threads
from photonormal.types import InputError


def numbered_pictures(folder: Path) -> list[Path]:
    """The photographs of a folder, one for each light: those that `filenames.txt` lists, or those with a number.

    `ref.jpg` or `ambient.png` beside `001.png`, `002.png`, ... is no photograph under one light. Of an `.lp` file, or a
    folder that holds one and no pictures, those that it names.
    """
    if folder.is_file() and rti.matches(folder):
        return _found(rti.named_pictures(folder), folder)
    _check_folder(folder)
    if (folder / "filenames.txt").is_file():
        return [folder / name for name in read_lines(folder / "filenames.txt")]
    pictures = find_pictures(folder)
    numbered = [p for p in pictures if re.search(r"\d", p.stem)]
    return numbered or _found(pictures or rti.named_pictures(folder), folder)


def _found(pictures: list[Path], place: Path) -> list[Path]:
    if not pictures:
        raise no_pictures(place)
    return pictures


def pictures_of(folder: Path) -> list[Path]:
    """Every picture of a folder that a calibration may read, its mask included."""
    _check_folder(folder)
    mask = find_mask(folder)
    return [*find_pictures(folder), *([mask] if mask else [])]


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder but one with photographs is needed; give that.")


def pictures_for(names: Sequence[str], folder: Path, what: str) -> list[Path]:
    """A folder's pictures of `what`, the sphere or a board, in the order of the object's pictures `names`.

    They go by name where names agree, else as they come.
    """
    pictures = numbered_pictures(folder)
    by_name = {p.name: p for p in pictures}
    if all(name in by_name for name in names):
        return [by_name[name] for name in names]
    missing = [name for name in names if name not in by_name]
    if len(missing) < len(names) / 2:
        raise InputError(
            f"{folder} shows {what} in no picture that is called {', '.join(missing[:8])}"
            f"{' and others' * (len(missing) > 8)}, but its others are called as the object's; move those of the "
            f"object elsewhere, or add {what}'s."
        )
    if len(pictures) != len(names):
        raise InputError(
            f"{folder} shows {what} under {len(pictures)} lights but there are {len(names)} photographs of the "
            "object; one picture of each for every light is needed, in the same order."
        )
    return list(pictures)


def images_of(images: ImageFiles, f: Callable[[np.ndarray], np.ndarray]) -> list[np.ndarray]:
    """``f(image)`` of every picture, in order, in threads."""
    return in_threads(lambda j: f(images[j]), range(len(images)), cores())


def brightest_of(images: ImageFiles) -> np.ndarray:
    """The brightest grey level of every pixel, (h, w)."""
    brightest = np.zeros(images.shape[1:3], np.float32)
    for j in range(len(images)):
        np.maximum(brightest, images[j].mean(-1), out=brightest)
    return brightest / max(1.0, float(brightest.max()))
