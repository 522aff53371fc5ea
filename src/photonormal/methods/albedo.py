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

STEEPEST = 0.1  # n.l below which a sample shows little
HIGH = 0.75  # quantile of I / n.l that lies in no shadow
DARK = 0.1  # of that, below which a sample surely does
MIDDLE = 0.6  # quantile of those left, the matt part at first: between highlights and shadows that other parts light
ROUNDS = 4  # of least squares
ABOVE, BELOW = 0.05, 0.1  # of what the albedo shows: what is farther off is a highlight or a shadow
PIXELS = 2**11  # worked on at a time: they fit into a cache


def lambertian_albedo(capture: Capture, normals: Normals) -> Float[np.ndarray, "h w 3"]:
    """Albedo of each channel, zero outside, without highlights and shadows where most lights show neither.

    Least squares of I_j = rho s_j with s_j = max(n.l_j, 0) by Cauchy's weights: samples count less the farther they are
    off, at first from the middle of I_j / s_j; above it, where highlights are, twice as soon as below. Linear, in the
    unit of the images (1 is a saturated sample under a light of intensity 1).
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
    level, rho = _matt_level(Y, S), np.zeros((len(S), len(channels)), np.float32)
    for _ in range(ROUNDS):
        shown = level * S
        off = Y - shown
        off /= np.maximum(BELOW * shown, 1e-9)
        above = off * (BELOW / ABOVE)
        np.maximum(above, np.negative(off, out=off), out=off)
        with np.errstate(over="ignore"):  # of large samples where no light is due; they weigh nothing
            off *= off
        off += 1
        rho = _least_squares(channels, S, np.divide(S, off, out=off))
        level = rho.mean(-1, keepdims=True)
    return rho


def _matt_level(Y: Float[np.ndarray, "p n"], S: Float[np.ndarray, "p n"]) -> Float[np.ndarray, "p 1"]:
    """Grey level over max(n.l, 0) without highlights and shadows, as a quantile shows it; 0 where no light is."""
    facing = S > STEEPEST * S.max(1, keepdims=True)
    ratio = np.where(facing, Y, np.inf) / S.clip(1e-9)
    ratio.sort(1)
    count = facing.sum(1, keepdims=True)
    return np.where(count, np.take_along_axis(ratio, matt_rank(ratio, count, MIDDLE), 1), 0)


def matt_rank(
    ratio: Float[np.ndarray, "p n"], count: Int[np.ndarray, "p 1"], quantile: float
) -> Int[np.ndarray, "p 1"]:
    """Which of a pixel's ascending I / n.l is a quantile of those in no shadow; `count` of them are of steep lights."""
    last = ratio.shape[1] - 1
    high = np.take_along_axis(ratio, np.minimum((HIGH * count).astype(int), last), 1)
    dark = (ratio < DARK * high).sum(1, keepdims=True)
    return np.minimum(dark + (quantile * (count - dark).clip(0)).astype(int), last)


def _least_squares(channels: np.ndarray, S: np.ndarray, weighted: np.ndarray) -> Float[np.ndarray, "p c"]:
    """argmin over rho of sum_j w_j (I_j - rho s_j)^2 of each channel, for w s."""
    total = np.maximum(np.einsum("pn,pn->p", weighted, S), 1e-6)
    return np.stack([np.einsum("pn,pn->p", weighted, I) / total for I in channels], axis=-1)
