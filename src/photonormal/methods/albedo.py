"""The reflectance that goes with given normals."""

from __future__ import annotations

import threading

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.masked import row_bands, taken
from photonormal.methods.engine import plan
from photonormal.methods.engine.near import seen_as_distant
from photonormal.types import Capture, Normals, box_of


def lambertian_albedo(capture: Capture, normals: Normals) -> Float[np.ndarray, "h w 3"]:
    """Albedo of each channel, zero outside: argmin over rho of sum_j (I_j - rho s_j)^2 with s_j = max(n.l_j, 0).

    Linear, in the unit of the images (1 is a saturated sample under a light of intensity 1). Highlights brighten it.
    """
    capture = seen_as_distant(capture, normals)
    solved = taken(normals.mask, capture.mask)
    columns = box_of(capture.mask)[1]
    albedo = np.zeros(normals.map.shape, np.float32)
    first = 0
    for rows in row_bands(capture.mask, plan.pixels(capture)):
        on = normals.mask[rows, columns]
        N = normals.map[rows, columns][on]  # (p, 3)
        count = int(capture.mask[rows, columns].sum())
        here = first + np.flatnonzero(solved[first : first + count])
        first += count
        albedo[rows, columns][on] = _albedo(capture, N, here, (rows, columns), on)
    return albedo


def _albedo(
    capture: Capture,
    N: Float[np.ndarray, "p 3"],
    pixels: Int[np.ndarray, " p"],
    window: tuple[slice, slice],
    on: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "p c"]:
    """That of a window's pixels `on`, whose numbers on the mask are `pixels`."""
    if capture.lights_at is None:
        cos = N @ capture.known_lights().T.astype(np.float32)  # (p, n)
    else:
        cos = np.einsum("pi,pni->pn", N, capture.lights_at[pixels])
    S = np.maximum(cos, 0)
    weighted = np.zeros((len(N), capture.images.shape[3]), np.float32)
    turns, turn = threading.Condition(), 0  # added in order, or the last bits would differ from run to run

    def add(j: int) -> None:
        nonlocal turn
        part = np.float32(0)
        try:
            part = S[:, j, None] * capture.window(j, *window)[on]
        finally:  # after an error, too: the next ones wait
            with turns:
                turns.wait_for(lambda: turn == j)
                weighted.__iadd__(part)
                turn += 1
                turns.notify_all()

    capture.each_image(add)
    return weighted / np.maximum((S**2).sum(1, keepdims=True), 1e-6)
