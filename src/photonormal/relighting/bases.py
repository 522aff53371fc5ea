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
    u, v = L[..., 0], L[..., 1]
    r = np.hypot(u, v)
    e = np.where(r > 0, u + 1j * v, 1) / np.where(r > 0, r, 1)  # exp(i phi)
    (cos1, sin1), (cos2, sin2), (cos3, sin3) = ((z.real, z.imag) for z in (e, e * e, e * e * e))
    s2 = c - c * c
    s, x, pi = np.sqrt(s2), 2 * c - 1, np.pi
    found = [
        np.full_like(c, 1 / np.sqrt(2 * pi)),
        np.sqrt(6 / pi) * cos1 * s,
        np.sqrt(3 / (2 * pi)) * x,
        np.sqrt(6 / pi) * sin1 * s,
        -np.sqrt(30 / pi) * cos2 * s2,
        np.sqrt(30 / pi) * cos1 * x * s,
        np.sqrt(5 / (2 * pi)) * (1 - 6 * s2),
        np.sqrt(30 / pi) * sin1 * x * s,
        -np.sqrt(30 / pi) * sin2 * s2,
        2 * np.sqrt(35 / pi) * cos3 * s * s2,
        -np.sqrt(210 / pi) * cos2 * x * s2,
        2 * np.sqrt(21 / pi) * cos1 * s * (1 - 5 * s2),
        np.sqrt(7 / (2 * pi)) * x * (1 - 10 * s2),
        2 * np.sqrt(21 / pi) * sin1 * s * (1 - 5 * s2),
        -np.sqrt(210 / pi) * sin2 * x * s2,
        2 * np.sqrt(35 / pi) * sin3 * s * s2,
    ]
    return np.stack(found[:terms], axis=-1)
