"""Which parts of a height field see each other, and which ones a light reaches."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.horizon import walk

DIRECTIONS = 24  # in which a point looks around
GROWTH = 1.06  # of the steps to what it sees
THICK = 0.5  # pixels of height that cast no shadow


def form_factors(height: Float[np.ndarray, "h w"], N: Float[np.ndarray, "h w 3"], parts: Int[np.ndarray, "h w"]) -> Any:
    """F (p, p), sparse: F_ij is the share of a matt point i's light that comes from point j, if all is as bright.

    In each direction around a point what rises above all before it is seen; F is the integral of the cosine over the
    angles that it rises by. What turns away from a point is the top of a wall where the step before faced it, and
    counts for that; else nothing is known of it, and it is left out. A convex surface's F is zero.

    Parameters
    ----------
    height : towards the camera in pixels
    N : normals, x right, y up, z to the camera
    parts : numbers of the connected parts, whose heights are known up to a constant each; 0 where there is no surface
    """
    from scipy.sparse import csr_matrix

    number = np.cumsum(parts.ravel() > 0).reshape(parts.shape) - 1
    rows, columns, shares = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0, np.float32)]
    for angle in 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS:
        x, y = float(np.cos(angle)), float(np.sin(angle))
        along, up = x * N[..., 0] + y * N[..., 1], N[..., 2]
        horizon = np.arctan2(-along, up)  # at first the surface's own plane
        wall = np.full(parts.shape, -1)  # the point one step before, where it faces
        for here, there, distance in walk(x, y, parts.shape, GROWTH):
            rise = np.arctan((height[there] - height[here]) / distance)
            seen = (parts[here] > 0) & (parts[here] == parts[there]) & (rise > horizon[here])
            low, high = horizon[here][seen], rise[seen]
            a, u = along[here][seen], up[here][seen]
            share = (_integral(a, u, high) - _integral(a, u, low)) * (2 / DIRECTIONS)
            horizon[here][seen] = high
            facing = along[there][seen] * np.cos(high) + up[there][seen] * np.sin(high) < 0
            source = np.where(facing, number[there][seen], wall[here][seen])
            wall[here] = -1
            wall[here][seen] = np.where(facing, source, -1)
            rows.append(number[here][seen][source >= 0])
            columns.append(source[source >= 0])
            shares.append(share[source >= 0].astype(np.float32))
    p = int(number[-1, -1]) + 1
    return csr_matrix((np.concatenate(shares), (np.concatenate(rows), np.concatenate(columns))), (p, p))


def _integral(along: np.ndarray, up: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Of n.w cos e over the elevation e, for w = (cos e, sin e) in a plane where the normal is (along, up)."""
    return along * (e / 2 + np.sin(2 * e) / 4) + up * np.sin(e) ** 2 / 2


def shadows(
    height: Float[np.ndarray, "h w"], parts: Int[np.ndarray, "h w"], L: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, "p n"]:
    """Where the surface stands in the way of each light; parameters as above. Of other parts nothing is known."""
    found = np.zeros((len(L), *parts.shape), bool)
    for l, hidden in zip(L, found, strict=True):
        flat = float(np.hypot(l[0], l[1]))
        if flat == 0:
            continue
        for here, there, distance in walk(l[0] / flat, l[1] / flat, parts.shape, GROWTH):
            above = height[there] > height[here] + (THICK + distance * l[2] / flat)
            hidden[here] |= above & (parts[here] == parts[there])
    return found[:, parts > 0].T
