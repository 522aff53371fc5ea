"""The functions of the light that files of RTI are sums of.

PTM: T. Malzbender, D. Gelb, H. Wolters, Polynomial texture maps, SIGGRAPH 2001. HSH: P. Gautron et al., A novel
hemispherical basis for accurate and efficient rendering, EGSR 2004.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Basis = Callable[[Float[np.ndarray, "*n 3"]], Float[np.ndarray, "*n k"]]


def ptm(L: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 6"]:
    """u^2, v^2, u v, u, v, 1 of unit lights (u, v, w), in the order of .ptm files."""
    u, v = L[..., 0], L[..., 1]
    return np.stack([u * u, v * v, u * v, u, v, np.ones_like(u)], axis=-1)


def hsh(L: Float[np.ndarray, "*n 3"], terms: int) -> Float[np.ndarray, "*n k"]:
    """The first 9 or 16 hemispherical harmonics, in the order of .rti files: orthonormal over the upper hemisphere.

    Lights below the horizon count as if they were on it.
    """
    c = L[..., 2].clip(0, 1)  # cos(theta)
    phi = np.arctan2(L[..., 1], L[..., 0])
    s2 = c - c * c
    s, x, pi = np.sqrt(s2), 2 * c - 1, np.pi
    found = [
        np.full_like(c, 1 / np.sqrt(2 * pi)),
        np.sqrt(6 / pi) * np.cos(phi) * s,
        np.sqrt(3 / (2 * pi)) * x,
        np.sqrt(6 / pi) * np.sin(phi) * s,
        -np.sqrt(30 / pi) * np.cos(2 * phi) * s2,
        np.sqrt(30 / pi) * np.cos(phi) * x * s,
        np.sqrt(5 / (2 * pi)) * (1 - 6 * s2),
        np.sqrt(30 / pi) * np.sin(phi) * x * s,
        -np.sqrt(30 / pi) * np.sin(2 * phi) * s2,
        2 * np.sqrt(35 / pi) * np.cos(3 * phi) * s * s2,
        -np.sqrt(210 / pi) * np.cos(2 * phi) * x * s2,
        2 * np.sqrt(21 / pi) * np.cos(phi) * s * (1 - 5 * s2),
        np.sqrt(7 / (2 * pi)) * x * (1 - 10 * s2),
        2 * np.sqrt(21 / pi) * np.sin(phi) * s * (1 - 5 * s2),
        -np.sqrt(210 / pi) * np.sin(2 * phi) * x * s2,
        2 * np.sqrt(35 / pi) * np.sin(3 * phi) * s * s2,
    ]
    return np.stack(found[:terms], axis=-1)
