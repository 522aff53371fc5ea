"""How open a relief lies: the share of an even sky that a surface sees, weighed by the cosine."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from photonormal.horizon import walk

SLICES = 8  # planes through the view axis
GROWTH = 1.1  # of the steps to what may stand in the way
SIDE = 512  # pixels of the longer side at which it is found


def step_for(h: int, w: int) -> int:
    """Which rows and columns of a picture are enough to find it on."""
    return max(1, -(-max(h, w) // SIDE))


def openness(
    height: Float[np.ndarray, "h w"], normals: Float[np.ndarray, "h w 3"], step: int = 1
) -> Float[np.ndarray, "h w"]:
    """From 0, buried, to 1, open, at each pixel, or each of every `step`-th row and column.

    What stands in the way is the relief itself, from each pixel to the end of the picture. In each plane the sky
    between the horizons of both sides is integrated as Jimenez et al. do it, Practical realtime strategies for accurate
    indirect occlusion, SIGGRAPH courses 2016.

    Parameters
    ----------
    height : towards the camera in pixels, NaN where there is none, which hides nothing
    normals : x right, y up, z to the camera
    """
    z, N = np.where(np.isfinite(height), height, -np.inf).astype(np.float32) / step, normals
    total = np.zeros(z.shape, np.float32)
    for angle in np.pi * np.arange(SLICES) / SLICES:
        x, y = np.cos(angle), np.sin(angle)
        along = x * N[..., 0] + y * N[..., 1]
        gamma = np.arctan2(along, N[..., 2])  # of the normal's shadow in this plane, from the view axis
        right = np.minimum(_horizon(z, x, y), gamma + np.pi / 2)
        left = np.maximum(-_horizon(z, -x, -y), gamma - np.pi / 2)
        arcs = sum(2 * a * np.sin(gamma) - np.cos(2 * a - gamma) + np.cos(gamma) for a in (right, left))
        total += np.hypot(along, N[..., 2]) * arcs / 4
    return (total / SLICES).clip(0, 1)


def _horizon(z: Float[np.ndarray, "h w"], x: float, y: float) -> Float[np.ndarray, "h w"]:
    """The angle from the view axis to where the sky begins in the direction x to the right, y up."""
    slope = np.full(z.shape, -np.inf, np.float32)
    for here, there, distance in walk(x, y, z.shape, GROWTH):
        with np.errstate(invalid="ignore"):  # no height from where there is none
            rise = (z[there] - z[here]) / np.float32(distance)
        slope[here] = np.fmax(slope[here], rise)
    return np.pi / 2 - np.arctan(slope)
