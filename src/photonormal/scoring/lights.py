"""Lights against true ones: angles between directions, and intensities up to one factor."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float

from photonormal.geometry import angle_deg
from photonormal.types import InputError


@dataclass(frozen=True)
class LightsScore:
    """Angles between directions in degrees; `intensity_percent` is `intensity_error`'s, None where none are known."""

    mean_deg: float
    median_deg: float
    most_deg: float
    intensity_percent: float | None = None

    def as_dict(self) -> dict[str, float]:
        """The numbers by name, rounded to what they mean; what is not known is left out."""
        return {k: round(v, 4) for k, v in asdict(self).items() if v is not None}


def score_lights(
    lights: Float[np.ndarray, "n 3"],
    truth: Float[np.ndarray, "m 3"],
    intensities: Float[np.ndarray, " n"] | None = None,
    true_intensities: Float[np.ndarray, " m"] | None = None,
) -> LightsScore:
    """How wrong n lights are; intensities, of any unit, are compared where both are given.

    Raises
    ------
    InputError
        If there are not as many lights as true ones.
    """
    lights, truth = np.asarray(lights, float), np.asarray(truth, float)
    if lights.shape != truth.shape:
        raise InputError(f"{len(lights)} lights came but {len(truth)} true ones; give the same lights in one order.")
    off = angle_deg(lights, truth)
    error = None
    if intensities is not None and true_intensities is not None:
        error = 100 * intensity_error(np.asarray(intensities, float), np.asarray(true_intensities, float))
    return LightsScore(float(off.mean()), float(np.median(off)), float(off.max()), error)


def intensity_error(e: Float[np.ndarray, " n"], truth: Float[np.ndarray, " n"]) -> float:
    """Mean of |s e - truth| / truth with the factor s of the least squares, as SDPS-Net's authors have it."""
    s = (e * truth).sum() / (e * e).sum()
    return float((np.abs(s * e - truth) / truth).mean())
