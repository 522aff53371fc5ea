"""Light that parts of a surface send each other, and by how much it brightens the albedo that was measured.

What a matt surface shows under light j is B_j = rho (s_j + F B_j), for s_j = max(n.l_j, 0) where no shadow falls and
the form factors F of the surface found (Nayar, Ikeuchi and Kanade, Shape from interreflections, IJCV 1991). Photographs
show an exposure times rho, which F B takes: rho = k a, for the albedo a in the unit of the images. Samples in shadow
show k, because they show no other light than k a F B, and light from everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.masked import box_of, means
from photonormal.materials.exchange import form_factors, shadows
from photonormal.methods.albedo import robust
from photonormal.methods.between import everywhere, tiles
from photonormal.methods.engine.near import seen_as_distant
from photonormal.types import Capture, Normals, RowMap, Surface

SIDE = 64  # pixels of the longer side of the grid on which it is found
LIGHTS = 32  # that are looked at, at most
PIXELS = 2**20  # read at a time
FILLED = 0.5  # of a square of pixels: it is on the grid
STEEPEST = 0.05  # n.v below which it is not; |n.l| below which it is unknown whether a light reaches it
ROUNDS = 6  # of exposure, albedo and light between parts
REWEIGHTED = 20  # rounds of least squares that find least absolute deviations
WHITE = 0.95  # most that the brightest parts reflect
SAMPLES = 200  # in shadow, which are needed
EXPLAINED = 0.25  # of what shadows show beside light from everywhere: less, and nothing is known


@dataclass(frozen=True)
class Brightening:
    """By how much light from other parts brightens the measured albedo.

    Parameters
    ----------
    logs : natural logarithm of the factor, at least 0, on a grid
    step : pixels between the grid's points, the first of which lies in the middle of `step` rows and columns
    corner : row and column of the frame where the grid begins
    exposure : albedo of each channel over the measured one
    """

    logs: Float[np.ndarray, "a b c"]
    step: int
    corner: tuple[int, int]
    exposure: Float[np.ndarray, " c"]

    def as_dict(self) -> dict[str, Any]:
        """What the report says: what was taken out of the measured albedo, the exposure."""
        percent = 100 * (1 - np.exp(-self.logs.mean(-1)))
        return {
            "median_percent": round(float(np.median(percent)), 2),
            "most_percent": round(float(percent.max()), 2),
            "exposure": [float(f"{k:.4g}") for k in self.exposure],  # small where samples are large numbers
        }

    def take_from(self, albedo: RowMap) -> None:
        """Divide an albedo (h, w, 3) by the factor, in place."""
        import cv2

        middle = (self.step - 1) / 2
        for rows, columns in tiles(*(slice(0, size) for size in albedo.shape[:2])):
            y, x = np.mgrid[rows, columns].astype(np.float32)
            x, y = ((v - (first + middle)) / self.step for v, first in ((x, self.corner[1]), (y, self.corner[0])))
            logs = cv2.remap(self.logs, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            part = albedo[rows]
            part[:, columns] *= np.exp(-logs).reshape(*x.shape, -1)
            albedo[rows] = part


@dataclass(frozen=True)
class Patches:
    """A capture on squares of pixels.

    Parameters
    ----------
    on : squares that are looked at
    height : towards the camera, in squares
    parts : numbers of connected parts, 0 outside
    albedo, I : the measured one, and what some of the lights show
    cos : n.l of these lights
    """

    on: Bool[np.ndarray, "a b"]
    height: Float[np.ndarray, "a b"]
    normals: Float[np.ndarray, "a b 3"]
    parts: Int[np.ndarray, "a b"]
    albedo: Float[np.ndarray, "p c"]
    I: Float[np.ndarray, "p n c"]
    L: Float[np.ndarray, "n 3"]
    cos: Float[np.ndarray, "p n"]


def brightening(
    capture: Capture, normals: Normals, surface: Surface, albedo: Float[np.ndarray, "h w 3"]
) -> Brightening | None:
    """By how much light between parts of the surface brightens an albedo; None where the photographs do not show it.

    They tell it where shadows show more light than what comes from everywhere, in the way that the surface found
    explains. The surface is taken for matt, and what lies behind it or outside the frame for black. The depth of parts
    that do not touch is not known, so that no light passes between them, and no shadow.
    """
    capture = seen_as_distant(capture, normals)
    box = box_of(normals.mask)
    step = max(1, -(-max(s.stop - s.start for s in box) // SIDE))
    patches = _patches(capture, normals, surface, albedo, box, step)
    found = _factors(patches) if patches.on.any() else None
    if found is None:
        return None
    factor, exposure = found
    logs = np.zeros((*patches.on.shape, factor.shape[1]), np.float32)
    logs[patches.on] = np.log(factor)
    return Brightening(everywhere(logs, patches.on), step, (box[0].start, box[1].start), exposure)


def _factors(patches: Patches) -> tuple[Float[np.ndarray, "p c"], Float[np.ndarray, " c"]] | None:
    """Measured over true albedo, and the exposure; None where it is not known."""
    S = patches.cos.clip(0)
    hidden = shadows(patches.height, patches.parts, patches.L)
    dark = (patches.cos < -STEEPEST) | (hidden & (patches.cos > STEEPEST))  # (p, n)
    if np.count_nonzero(dark) < SAMPLES:
        return None
    F = form_factors(patches.height, patches.normals, patches.parts)
    if not F.nnz:
        return None
    open = 1 - np.asarray(F.sum(1))  # (p, 1)
    s = (S * ~hidden)[..., None]  # (p, n, 1)
    a, shown = patches.albedo, patches.I[dark]  # (p, c), (m, c)
    k, factor, B = np.ones(a.shape[1], np.float32), np.ones_like(a), a[:, None] * s
    for _ in range(ROUNDS):
        E = a[:, None] * s  # (p, n, c)
        B = E + k * a[:, None] * _received(F, B)
        sent, sky = a[:, None] * _received(F, B), np.broadcast_to((a * open)[:, None], B.shape)
        found = [_exposure(*(each[..., c] for each in (sent[dark], sky[dark], shown))) for c in range(len(k))]
        if np.mean([explained for _, explained in found]) < EXPLAINED:
            return None
        k = np.minimum([each for each, _ in found], WHITE / np.quantile(a, 0.99, axis=0).clip(1e-6)).astype(np.float32)
        direct, whole = robust(E, S), robust(E + k * sent, S)
        factor = np.where(direct > 1e-6, whole / direct.clip(1e-6), 1).clip(1)
        a = patches.albedo / factor
    return factor, k


def _received(F: Any, B: Float[np.ndarray, "p n c"]) -> Float[np.ndarray, "p n c"]:
    """F B_j of each light and channel."""
    return (F @ B.reshape(len(B), -1)).reshape(B.shape)


def _exposure(
    sent: Float[np.ndarray, " m"], sky: Float[np.ndarray, " m"], I: Float[np.ndarray, " m"]
) -> tuple[Any, Any]:
    """argmin over k >= 0 and q >= 0 of sum |I - k sent - q sky|, and how much of the sum `sent` explains."""
    both, alone = np.stack([sent, sky], 1), sky[:, None]
    (k, *_), left = _least_deviations(both, I)
    _, without = _least_deviations(alone, I)
    return k, 1 - left / max(without, 1e-12)


def _least_deviations(X: Float[np.ndarray, "m k"], I: Float[np.ndarray, " m"]) -> tuple[np.ndarray, float]:
    from scipy.optimize import nnls

    w, least = np.ones(len(I)), 1e-3 * I.mean() + 1e-9
    x, off = np.zeros(X.shape[1]), I
    for _ in range(REWEIGHTED):
        root = np.sqrt(w)
        x = nnls(X * root[:, None], I * root)[0]
        off = np.abs(I - X @ x)
        w = least / np.maximum(off, least)
    return x, float(off.sum())


def _patches(
    capture: Capture, normals: Normals, surface: Surface, albedo: np.ndarray, box: tuple[slice, slice], step: int
) -> Patches:
    import cv2

    known = normals.mask & surface.mask
    n, _, _, c = capture.images.shape
    chosen = np.unique(np.linspace(0, n - 1, min(n, LIGHTS)).round().astype(int))
    bands = _bands(box, step)
    labels = cv2.connectedComponents(known[box].astype(np.uint8), connectivity=4)[1]
    number: list[np.ndarray] = []  # of one of the mask's pixels in each square
    layers: dict[str, list[np.ndarray]] = {"share": [], "normals": [], "height": [], "albedo": [], "parts": []}
    for rows in bands:
        window, here = (rows, box[1]), known[rows, box[1]]
        share = means(here.astype(np.float32), step)
        layers["share"].append(share)
        part = Surface(surface.depth[window], here, surface.K).heights_px()
        for name, map in (("normals", normals.map[window]), ("height", part), ("albedo", albedo[window])):
            layers[name].append(_mean(map, here, share, step))
        layers["parts"].append(_most(labels[rows.start - box[0].start : rows.stop - box[0].start], step))
        if capture.lights_at is not None:
            asked = capture.mask[rows]
            last = np.count_nonzero(capture.mask[: rows.start]) + np.cumsum(asked).reshape(asked.shape) - 1
            number.append(_most(np.where(here, last[:, box[1]], 0), step))
    joined = {name: np.concatenate(each) for name, each in layers.items()}
    N = joined["normals"] / np.maximum(np.linalg.norm(joined["normals"], axis=-1, keepdims=True), 1e-9)
    on = (joined["share"] >= FILLED) & (N[..., 2] > STEEPEST)

    def photograph(j: int) -> Float[np.ndarray, "p c"]:
        parts = [
            _mean(capture.window(j, rows, box[1]), known[rows, box[1]], share, step)
            for rows, share in zip(bands, layers["share"], strict=True)
        ]
        return np.concatenate(parts)[on]

    I = np.stack([photograph(int(j)) for j in chosen], 1)  # (p, n, c)
    if capture.lights_at is None:
        L = capture.known_lights()[chosen].astype(np.float32)
        cos = N[on] @ L.T
    else:
        at = np.asarray(capture.lights_at[np.concatenate(number)[on]], np.float32)[:, chosen]  # (p, n, 3)
        cos, L = np.einsum("pi,pni->pn", N[on], at), at.mean(0)
    parts = joined["parts"] * on
    return Patches(on, joined["height"] / step, N, parts, joined["albedo"][on][:, :c], I, L, cos.astype(np.float32))


def _bands(box: tuple[slice, slice], step: int) -> list[slice]:
    """Rows of the box, whole squares at a time."""
    rows, columns = box
    each = step * max(1, PIXELS // (step * (columns.stop - columns.start)))
    return [slice(y, min(y + each, rows.stop)) for y in range(rows.start, rows.stop, each)]


def _mean(map: np.ndarray, inside: np.ndarray, share: np.ndarray, step: int) -> Float[np.ndarray, "a b ..."]:
    """Over the pixels of each square that are inside."""
    more = (...,) + (None,) * (map.ndim - 2)
    return means(np.where(inside[more], map, 0).astype(np.float32), step) / np.maximum(share, 1e-9)[more]


def _most(map: Int[np.ndarray, "h w"], step: int) -> Int[np.ndarray, "a b"]:
    """The largest value of each square."""
    h, w = map.shape
    padded = np.pad(map, ((0, -h % step), (0, -w % step)), mode="edge")
    return padded.reshape(-(-h // step), step, -(-w // step), step).max((1, 3))
