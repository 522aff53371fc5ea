"""The curve of sRGB (IEC 61966-2-1), both ways."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def to_linear(encoded: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Linear radiance in [0, 1], float32, from sRGB-encoded values in [0, 1]."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(np.float32)


def from_linear(linear: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """sRGB-encoded values in [0, 1] from linear radiance in [0, 1]."""
    encoded = np.asarray(linear ** (1 / 2.4))
    encoded *= 1.055
    encoded -= 0.055
    return np.multiply(linear, 12.92, out=encoded, where=linear <= 0.0031308)
