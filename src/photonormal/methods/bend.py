"""How much a surface turns within a small part of its object: there a small shift is a large error."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from photonormal.methods.between import between
from photonormal.types import Normals

PART = 0.02  # of the object's size, the root of its area
AROUND = 2.0  # standard deviation of the place over which turns are averaged, in parts
PIXELS = 2**14  # of the object that are looked at: some rows and columns of larger ones
LEAST = 1e-3  # degrees


def bend_deg(normals: Normals) -> Float[np.ndarray, "h w"]:
    """Mean angle around each pixel, in degrees, between normals that lie PART of the object's size apart.

    NaN outside the mask; LEAST at least, also where no two pixels lie that far apart.
    """
    step = max(1, int(np.ceil(np.sqrt(normals.mask.sum() / PIXELS))))
    some = normals.mask[::step, ::step]
    if step == 1 or not some.any():
        return _bend_deg(normals.map, normals.mask)
    return between(_bend_deg(normals.map[::step, ::step], some), normals.mask, step)


def _bend_deg(N: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    import cv2

    size = PART * np.sqrt(mask.sum())
    lag = max(1, round(size))
    angles, pairs = np.zeros(mask.shape, np.float32), np.zeros(mask.shape, np.float32)
    for axis in (0, 1):
        a, b = (tuple(s if k == axis else slice(None) for k in (0, 1)) for s in (slice(lag, None), slice(None, -lag)))
        both = mask[a] & mask[b]
        step = N[a] - N[b]
        apart = np.degrees(np.sqrt(np.einsum("hwk,hwk->hw", step, step))) * both  # chords: enough where a part is small
        for side in (a, b):
            angles[side] += apart
            pairs[side] += both
    angles, pairs = (np.asarray(cv2.GaussianBlur(v, (0, 0), AROUND * lag)) for v in (angles, pairs))
    bend = (angles / pairs.clip(min=1e-6) * (size / lag)).clip(min=LEAST)
    return np.where(mask, bend, np.nan).astype(np.float32)
