"""Normals against the truth: mean angular error and its companions, over pixels where both are known."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float, UInt8

from photonormal.geometry import angle_deg
from photonormal.types import InputError, Normals, as_normals

SCALE_DEG = 45.0  # error that the last colour of every error map stands for
ROWS = 256  # coloured at a time


@dataclass(frozen=True)
class Score:
    """Angular errors in degrees; `below_15` and `below_30` in per cent of the pixels; `pixels` that were compared."""

    mean_deg: float
    median_deg: float
    below_15: float
    below_30: float
    pixels: int

    def as_dict(self) -> dict[str, float | int]:
        """The numbers by name, rounded to what they mean."""
        return {k: round(v, 4) for k, v in asdict(self).items()}


def angular_error_deg(estimate: Normals, truth: Normals) -> Float[np.ndarray, " p"]:
    """Angle between normals, in degrees, at the p pixels where both are known.

    A vector, not a map, so that no background zero can enter a mean. Where the estimate has no normal (no light reached
    the pixel) there is no angle either: `score` says how many pixels were compared.
    """
    if estimate.mask.shape != truth.mask.shape:
        raise InputError(
            f"normals are {estimate.mask.shape} but the truth is {truth.mask.shape}; both must show the same frame."
        )
    both = estimate.mask & truth.mask
    return angle_deg(estimate.map[both], truth.map[both])


def score(estimate: Normals | np.ndarray, truth: Normals | np.ndarray | None) -> Score:
    """Mean and median angular error, and the shares of pixels below 15 and 30 degrees.

    Raises
    ------
    InputError
        If the sizes differ, no pixel has both an estimate and a truth, or there is no truth.
    """
    estimate, truth = as_normals(estimate), as_normals(truth, "true normals")
    error = angular_error_deg(estimate, truth)
    if not error.size:
        raise InputError("no pixel has both an estimated and a true normal; check that the masks overlap.")
    return Score(
        mean_deg=float(error.mean()),
        median_deg=float(np.median(error)),
        below_15=100 * float((error < 15).mean()),
        below_30=100 * float((error < 30).mean()),
        pixels=int(error.size),
    )


def error_map_deg(estimate: Normals, truth: Normals) -> Float[np.ndarray, "h w"]:
    """Angular error in degrees of every pixel, NaN where either normal is unknown."""
    both = estimate.mask & truth.mask
    error = np.full(both.shape, np.nan)
    error[both] = angular_error_deg(estimate, truth)
    return error


def error_picture(estimate: Normals, truth: Normals) -> UInt8[np.ndarray, "h w 3"]:
    """The error map in colours (RGB): dark blue is 0, yellow SCALE_DEG degrees or more, white has no truth."""
    return colours(error_map_deg(estimate, truth))


def colours(error: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Angles in degrees as `error_picture` colours them; white where there is none."""
    import cv2

    picture = np.empty((*error.shape, 3), np.uint8)
    for top in range(0, len(error), ROWS):
        rows = slice(top, top + ROWS)
        level = np.nan_to_num(error[rows] / SCALE_DEG).clip(0, 1)
        picture[rows] = cv2.applyColorMap((255 * level).round().astype(np.uint8), cv2.COLORMAP_CIVIDIS)[..., ::-1]
        picture[rows][np.isnan(error[rows])] = 255
    return picture
