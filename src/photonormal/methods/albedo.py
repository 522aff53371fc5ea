"""The reflectance that goes with given normals."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from photonormal.masked import box_of, row_bands, taken
from photonormal.methods.engine import plan
from photonormal.methods.engine.near import seen_as_distant
from photonormal.methods.inputs.workers import side_by_side
from photonormal.progress import progress
from photonormal.shading import cosines
from photonormal.types import Capture, Normals

ROUNDS = 4  # after least squares
SPREAD = 0.1  # of samples about the albedo, over what it shows: what is farther off is a highlight or a shadow
PIXELS = 2**12  # worked on at a time: they fit into a cache


def lambertian_albedo(capture: Capture, normals: Normals) -> Float[np.ndarray, "h w 3"]:
    """Albedo of each channel, zero outside, without highlights and shadows where most lights show neither.

    Least squares of I_j = rho s_j with s_j = max(n.l_j, 0), then again with Cauchy's weights: samples count less the
    farther they are off. Linear, in the unit of the images (1 is a saturated sample under a light of intensity 1).
    """
    capture = seen_as_distant(capture, normals)
    solved = taken(normals.mask, capture.mask)
    columns = box_of(capture.mask)[1]
    albedo = np.zeros(normals.map.shape, np.float32)
    first = 0
    with progress("albedo", len(solved)) as advance:
        for rows in row_bands(capture.mask, plan.pixels(capture) // 2):  # all channels are held, twice
            on = normals.mask[rows, columns]
            N = normals.map[rows, columns][on]  # (p, 3)
            count = int(capture.mask[rows, columns].sum())
            here = first + np.flatnonzero(solved[first : first + count])
            first += count
            albedo[rows, columns][on] = _albedo(capture, N, here, (rows, columns), on)
            advance(count)
    return albedo


def _albedo(
    capture: Capture,
    N: Float[np.ndarray, "p 3"],
    pixels: Int[np.ndarray, " p"],
    window: tuple[slice, slice],
    on: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "p c"]:
    """That of a window's pixels `on`, whose numbers on the mask are `pixels`."""
    I = capture.samples(*window, on)  # (p, n, c)

    def found(some: slice) -> Float[np.ndarray, "q c"]:
        L = capture.known_lights() if capture.lights_at is None else capture.lights_at[pixels[some]]
        cos = cosines(torch.from_numpy(N[some]), torch.as_tensor(L, dtype=torch.float32))  # (q, n)
        return robust(I[some], cos.clamp(min=0).numpy())

    parts = [slice(first, first + PIXELS) for first in range(0, len(N), PIXELS)]
    return np.concatenate([np.empty((0, I.shape[2]), np.float32), *side_by_side(found, parts, torch.device("cpu"))])


def robust(I: Float[np.ndarray, "p n c"], S: Float[np.ndarray, "p n"]) -> Float[np.ndarray, "p c"]:
    channels = np.ascontiguousarray(np.moveaxis(I, 2, 0))  # each by itself: several times faster than three together
    Y = channels.mean(0)
    rho = _least_squares(channels, S, S)
    for _ in range(ROUNDS):
        shown = rho.mean(-1, keepdims=True) * S
        off = Y - shown
        off /= np.maximum(SPREAD * shown, 1e-9)
        off *= off
        off += 1
        rho = _least_squares(channels, S, np.divide(S, off, out=off))
    return rho


def _least_squares(channels: np.ndarray, S: np.ndarray, weighted: np.ndarray) -> Float[np.ndarray, "p c"]:
    """argmin over rho of sum_j w_j (I_j - rho s_j)^2 of each channel, for w s."""
    total = np.maximum(np.einsum("pn,pn->p", weighted, S), 1e-6)
    return np.stack([np.einsum("pn,pn->p", weighted, I) / total for I in channels], axis=-1)
