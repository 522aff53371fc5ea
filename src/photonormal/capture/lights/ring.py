"""Lamps at known steps around the object, whose lights need no file."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from photonormal.types import InputError

MOST = 10_000  # lamps


def ring(
    count: int, elevation_deg: float | None, start_deg: float = 0, clockwise: bool = False
) -> Float[np.ndarray, "n 3"]:
    """Unit vectors to `count` lamps at equal steps on a circle around the view axis, in the order of the pictures.

    Parameters
    ----------
    elevation_deg : height of the lamps over the plane of the picture, above 0 and below 90
    start_deg : where the first one is: 0 at the right of the picture, 90 at its top
    clockwise : as the camera sees them; else counter-clockwise
    """
    if elevation_deg is None or not 0 < elevation_deg < 90:
        came = "no --elevation" if elevation_deg is None else f"--elevation {elevation_deg:g}"
        raise InputError(
            f"--ring {count} came with {came} but the lamps' height over the plane of the picture is needed, in "
            "degrees above 0 and below 90; add it."
        )
    if not 3 <= count <= MOST:
        raise InputError(f"--ring {count} came but 3 to {MOST} lamps are needed; correct it.")
    if not np.isfinite(start_deg):
        raise InputError(f"--start {start_deg} came but degrees are needed; correct it.")
    azimuth = np.radians(start_deg + (-1 if clockwise else 1) * np.arange(count) * 360 / count)
    elevation = np.radians(elevation_deg)
    xy = np.cos(elevation) * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    return np.concatenate([xy, np.full((count, 1), np.sin(elevation))], axis=1)
