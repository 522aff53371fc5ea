"""Unit vectors, rotations and angles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from photonormal.types import by_name

FRAMES = {  # frame -> its three axes as axes of ours (1: x right, 2: y up, 3: z to the camera), negative where reversed
    "opengl": (1, 2, 3),  # ours; DiLiGenT, PS-FCN, relight's .lp and normal maps
    "directx": (1, -2, 3),  # green down: y down, z to the camera
    "y-down": (1, -2, -3),  # cameras of OpenCV, LUCES and AliceVision: y down, z into the scene
    "z-away": (1, 2, -3),  # Direct3D's view space: y up, z into the scene
    "blender": (1, -3, 2),  # world space seen from the front: x right, y away from the camera, z up
}


def known_frame(name: str) -> tuple[int, int, int]:
    """The axes of a frame; InputError where there is none of that name."""
    return by_name("frame", name, FRAMES)


def in_frame(v: Float[np.ndarray, "*b 3"], name: str) -> Float[np.ndarray, "*b 3"]:
    """Vectors of our frame in the one called `name`."""
    axes = np.array(known_frame(name))
    found = v.take(np.abs(axes) - 1, axis=-1)
    found *= np.sign(axes).astype(v.dtype)
    return found


def from_frame(v: Float[np.ndarray, "*b 3"], name: str) -> Float[np.ndarray, "*b 3"]:
    """Vectors of the frame called `name` in ours."""
    axes = np.array(known_frame(name))
    return (v * np.sign(axes).astype(v.dtype)).take(np.argsort(abs(axes)), axis=-1)


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


def fibonacci_cap(n: int, lowest_deg: float) -> Float[np.ndarray, "n 3"]:
    """The same over the part of the hemisphere that is so high above the horizon."""
    lowest, l = np.sin(np.radians(lowest_deg)), fibonacci_hemisphere(n)
    z = lowest + (1 - lowest) * l[:, 2]
    r = np.sqrt(1 - z**2) / np.linalg.norm(l[:, :2], axis=1)
    return np.concatenate([l[:, :2] * r[:, None], z[:, None]], 1)


def far_apart(v: Float[np.ndarray, "n 3"], count: int) -> list[int]:
    """Which `count` vectors lie far apart: the one nearest to the view, then always the farthest from all taken."""
    taken = [int(v[:, 2].argmax())]
    nearest = angle_deg(v, np.broadcast_to(v[taken[0]], v.shape))
    while len(taken) < min(count, len(v)):
        taken.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, angle_deg(v, np.broadcast_to(v[taken[-1]], v.shape)))
    return taken
