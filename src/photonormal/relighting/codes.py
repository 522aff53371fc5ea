"""Coefficients in 8 bits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

LEVELS = 254  # steps of a coefficient's range; one level of 8 bits is left for the rounding of zero's place


@dataclass(frozen=True)
class Codes:
    """A coefficient is (code - zero) step.

    Parameters
    ----------
    step : (k,) what one level of the code is
    zero : (k,) whole numbers from 0 to 255, the codes of 0
    """

    step: Float[np.ndarray, " k"]
    zero: Float[np.ndarray, " k"]

    @classmethod
    def of(cls, parts: Iterable[Float[np.ndarray, "... k"]]) -> Codes:
        """Codes whose range reaches from the least to the largest, and to 0: what is outside the mask is black."""
        low = high = np.zeros(1)
        for C in parts:
            each = tuple(range(C.ndim - 1))
            low, high = np.minimum(low, C.min(each)), np.maximum(high, C.max(each))
        step = np.maximum(high - low, 1e-6) / LEVELS
        return cls(step, np.rint(-low / step))

    def __call__(self, C: Float[np.ndarray, "*p k"]) -> UInt8[np.ndarray, "*p k"]:
        """The codes of coefficients."""
        levels = C / self.step.astype(np.float32)
        levels += self.zero.astype(np.float32)
        return np.rint(levels, out=levels).clip(0, 255, out=levels).astype(np.uint8)
