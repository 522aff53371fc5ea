"""Unit vectors, rotations and angles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from photonormal.types import InputError

FRAMES = {  # vectors of another convention times these are in ours (x right, y up, z to the camera), and back
    "opengl": (1.0, 1.0, 1.0),  # DiLiGenT, PS-FCN, relight's .lp and normal maps; ours
    "directx": (1.0, -1.0, 1.0),  # green down: y down, z to the camera
    "y-down": (1.0, -1.0, -1.0),  # cameras of OpenCV, LUCES and AliceVision: y down, z into the scene
}


def known_frame(name: str) -> tuple[float, float, float]:
    """The factors of a frame; InputError where there is none of that name."""
    if name not in FRAMES:
        raise InputError(f"no frame {name!r}; choose from {', '.join(FRAMES)}.")
    return FRAMES[name]


def in_frame(v: Float[np.ndarray, "*b 3"], name: str) -> Float[np.ndarray, "*b 3"]:
    """Vectors of our frame in the one called `name`, and the other way round."""
    return v * np.array(known_frame(name), v.dtype)


def normalised(v: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
    """Vectors of length one in the direction of `v`; zero stays zero."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.zeros_like(v), where=length > 0)


def angle_deg(a: Float[np.ndarray, "*b 3"], b: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b"]:
    """Angle between vectors in degrees, [0, 180]; ``atan2`` keeps full precision near 0 where ``arccos`` loses it."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1)))


def rotation_about_view(degrees: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about the view axis z, counter-clockwise as the camera sees it."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def fibonacci_hemisphere(n: int) -> Float[np.ndarray, "n 3"]:
    """`n` unit vectors spread evenly over the hemisphere around +z."""
    k = np.arange(n) + 0.5
    z = 1 - k / n
    r, phi = np.sqrt(1 - z**2), np.pi * (1 + 5**0.5) * k
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)
