"""Lamps near the object: vectors of a file are positions in mm once the scale is known."""

from __future__ import annotations

import numpy as np

from photonormal.capture.lights.table import UNEQUAL
from photonormal.types import Camera, InputError, Lamps

LONG = 10.0  # vectors that are all so long are rather positions in mm than directions


def placed_lamps(
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


def long_directions(vectors: np.ndarray | None, lamps: Lamps | None) -> list[str]:
    """What the user should know of (n, 3) vectors that were taken for directions and look like a dome's positions."""
    if vectors is None or lamps is not None:
        return []
    with np.errstate(all="ignore"):
        length = np.linalg.norm(vectors, axis=1)
    if not LONG <= length.min() <= length.max() <= UNEQUAL * length.min():  # the reader remarks on these
        return []
    return [
        f"the lights' vectors are {np.median(length):.3g} long and were taken for directions; if they are positions in "
        "mm, add --mm-per-px, the width of a pixel on the object."
    ]
