"""How far each normal is expected to be off, in degrees.

What a pixel's samples say about its normal is put into a few numbers (`evidence`): how well a matt surface of that
normal explains them, how much lies in shadow, how well the lights fix a normal, how far two cheap methods disagree;
and what the method itself tells, where a network does. A calibration of each method, fitted to rendered scenes
(`benchmarks/expected.py --fit`), maps them to a mean error.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.shading import angle_deg, cosines, over_lights, shade
from photonormal.solve.classical.trimmed import Trimmed
from photonormal.solve.classical.woodham import Woodham, pairs, symmetric_inverse, symmetric_product
from photonormal.solve.engine.near import seen_as_distant
from photonormal.solve.inputs.grey import blocks, grey_levels, lights_of, lit, seen_from
from photonormal.types import Capture, Normals

FILE = Path(__file__).with_name("expected.json")
EVIDENCE = (
    "residual",  # ln: root mean square of what the Lambertian fit leaves, relative to the fit; lit samples, n.l > 0
    "usual residual",  # ln: the same of most samples, a mean that outliers hardly move
    "shine",  # ln: root mean square of what exceeds the fit
    "cast shadow",  # share of the samples that the normal says are lit but are dark
    "contradiction",  # share that the normal says are dark but are lit
    "lit",  # share
    "uncertainty",  # ln: error of the normal, radians, for an error of the samples as large as the samples
    "woodham",  # ln: degrees to the least-squares normal
    "trimmed",  # ln: degrees to the normal of the samples of middle brightness
    "dim",  # ln: degrees to the normal of the dimmer samples
    "slant",  # ln: n.v
    "peak",  # ln: brightest sample over the mean lit one
    "level",  # ln: mean lit sample, over that of the object's bright parts
    "evenness",  # mean root over the root of the mean, of lit samples
    "images",  # ln: their number
    "told",  # ln: degrees that the method itself expects, or 0
)
OF_ALL = ("usual residual", "trimmed", "woodham", "uncertainty")  # means over the object count, too
PRODUCTS = (  # that are terms, too
    *((name, name) for name in ("usual residual", "woodham", "trimmed", "uncertainty", "slant")),
    ("usual residual", "trimmed"),
    ("trimmed", "uncertainty"),
)
FITTED = 3, 100  # images of the scenes that calibrations were fitted to
PIXELS = 2**20  # whose terms are held at a time
DIM = Trimmed(lowest=0.0, highest=0.35)


def with_expected_error(normals: Normals, capture: Capture, method: str, device: torch.device) -> Normals:
    """The normals that a method found, with how far each is expected to be off.

    Unchanged where a method has no calibration. `capture` is the one that was solved, or that one with its near lamps
    evened out (`photonormal.solve.engine.near.seen_as_distant`), which saves doing it again.
    """
    if method not in calibrations():
        return normals
    F = evidence_of(seen_as_distant(capture, normals), normals, device)
    found = calibrations()[method](F.cpu().numpy())
    expected = np.full(normals.mask.shape, np.nan, np.float32)
    expected[normals.mask] = found
    return replace(normals, expected_error_deg=expected)


def evidence_of(capture: Capture, normals: Normals, device: torch.device) -> Float[Tensor, "p k"]:
    """`evidence` of every pixel that has a normal, block by block."""
    solved = torch.from_numpy(normals.mask[capture.mask])
    I = grey_levels(capture)
    keep = lit(I)
    L = lights_of(capture, device)
    if not bool(solved.all()):
        I, keep, L = I[solved], keep[solved], L if L.ndim == 2 else L[solved.to(device)]
    N = torch.from_numpy(normals.map[normals.mask]).to(device)
    v = to_camera(capture)[normals.mask].to(device)
    found = [
        evidence(I[s].to(device), keep[s].to(device), seen_from(L, s), N[s], v[s])
        for s in blocks(I.shape[0], I.shape[1], device)
    ]
    F = torch.cat(found)
    level = F[:, EVIDENCE.index("level")]
    bright = np.quantile(level.cpu().numpy(), 0.9)
    level.copy_((level - bright).clamp(min=np.log(1e-2)))
    if normals.expected_error_deg is not None:
        told = torch.from_numpy(normals.expected_error_deg[normals.mask]).to(F)
        F[:, EVIDENCE.index("told")] = logarithm(told, 0.1)
    return F


def to_camera(capture: Capture) -> Float[Tensor, "h w 3"]:
    """Unit vectors from each pixel's surface to the camera."""
    h, w = capture.mask.shape
    v = torch.tensor([0.0, 0.0, 1.0]).expand(h, w, 3)
    if capture.camera is None or capture.camera.K is None:
        return v
    rays = torch.from_numpy(-capture.camera.rays(h, w)).float()
    return rays / rays.norm(dim=-1, keepdim=True)


def evidence(
    I: Float[Tensor, "p n"],
    keep: Bool[Tensor, "p n"],
    L: Float[Tensor, "*l n 3"],
    N: Float[Tensor, "p 3"],
    v: Float[Tensor, "p 3"],
) -> Float[Tensor, "p k"]:
    """The numbers that EVIDENCE names, from the samples to `keep` and the unit normals found; finite, whatever came."""
    cos = cosines(N, L)
    S = shade(1.0, cos)
    use = (keep & (cos > 0)).to(I.dtype)
    count = use.sum(1)
    SS = (use * S * S).sum(1).clamp(min=1e-9)
    albedo = (use * S * I).sum(1) / SS
    fit = (albedo * (SS / count.clamp(min=1)).sqrt()).clamp(min=1e-9)  # root mean square of the samples' fit
    r = (I - albedo[:, None] * S) / fit[:, None]
    free = (count - 3).clamp(min=0.5)  # three numbers were fitted
    residual = ((use * r**2).sum(1) / free).sqrt()
    usual = ((use * r.abs().sqrt()).sum(1) / count.clamp(min=1)) ** 2 * (count.clamp(min=1) / free).sqrt()
    shine = ((use * r.clamp(min=0) ** 2).sum(1) / free).sqrt()
    lit_count = keep.to(I.dtype).sum(1).clamp(min=1)
    mean = (I * keep).sum(1) / lit_count
    others = [Woodham().normals(I, L), Trimmed().fit(I, keep, L), DIM.fit(I, keep, L)]
    numbers = [
        logarithm(residual, 1e-3).clamp(max=2),
        logarithm(usual, 1e-3).clamp(max=2),
        logarithm(shine, 1e-3).clamp(max=2),
        (~keep & (cos > 0.1)).to(I.dtype).mean(1),
        (keep & (cos <= 0)).to(I.dtype).mean(1),
        keep.to(I.dtype).mean(1),
        uncertainty(use, L, N).log(),
        *(logarithm(angle_deg(N, other), 0.1) for other in others),
        logarithm((N * v).sum(1), 0.05),
        logarithm(I.amax(1) / mean.clamp(min=1e-9), 1.0).clamp(max=4),
        logarithm(mean, 1e-9),
        (I * keep).sqrt().sum(1) / lit_count / mean.clamp(min=1e-9).sqrt(),
        torch.full_like(mean, I.shape[1]).log(),
        torch.zeros_like(mean),
    ]
    return torch.nan_to_num(torch.stack(numbers, dim=1))


def logarithm(x: Float[Tensor, " p"], least: float) -> Float[Tensor, " p"]:
    """ln x of what is at least `least`."""
    return x.clamp(min=least).log()


def uncertainty(use: Float[Tensor, "p n"], L: Float[Tensor, "*l n 3"], N: Float[Tensor, "p 3"]) -> Float[Tensor, " p"]:
    """sqrt(tr A^-1 - n.A^-1 n) with A = sum_j l_j l_j^T over the samples used: across the normal alone."""
    A, _ = symmetric_inverse(over_lights(use, pairs(L)))
    along = (N * symmetric_product(A, N)).sum(1)
    trace = (A[:, 0] + A[:, 3] + A[:, 5]).to(N.dtype)
    across = (trace - along).clamp(min=1e-8).sqrt()
    return torch.where(use.sum(1) >= 3, across, torch.full_like(across, 10)).clamp(min=1e-3, max=10)


@dataclass(frozen=True)
class Calibration:
    """From evidence to degrees: a logarithm linear in `terms`, bent by a rising curve; both fitted at some `images`.

    Between those numbers of images the logarithm is interpolated over theirs; beyond, the nearest is taken.

    Parameters
    ----------
    images : (m,) rising
    weights : (m, 1 + t) the constant's first
    curve : (m, 2, c) ln degrees of the linear form, and what they mean
    """

    images: Float[np.ndarray, " m"]
    weights: Float[np.ndarray, "m t1"]
    curve: Float[np.ndarray, "m 2 c"]

    def __call__(self, F: Float[np.ndarray, "p k"]) -> Float[np.ndarray, " p"]:
        """Expected errors, degrees, 0.05 to 90, of pixels of one capture."""
        images = EVIDENCE.index("images")
        place = np.interp(F[0, images], np.log(self.images), np.arange(len(self.images)))
        k = min(int(place), len(self.images) - 2)
        found = []
        for first in range(0, len(F), PIXELS):
            part = F[first : first + PIXELS].astype(np.float64)
            part[:, images] = part[:, images].clip(*np.log(FITTED))
            T = terms(part, F)
            low, high = (np.interp(linear(T, self.weights[i]), *self.curve[i]) for i in (k, k + 1))
            found.append(np.exp(low + (place - k) * (high - low)).clip(0.05, 90))
        return np.concatenate(found)


def terms(F: Float[np.ndarray, "p k"], whole: Float[np.ndarray, "all k"]) -> Float[np.ndarray, "p t"]:
    """What the logarithm is linear in: evidence of some pixels, means of some of it over the `whole`, products."""
    column = {name: F[:, i] for i, name in enumerate(EVIDENCE)}
    over_all = dict(zip(EVIDENCE, whole.mean(0, dtype=np.float64), strict=True))
    means = [np.full(len(F), over_all[name]) for name in OF_ALL]
    products = [column[a] * column[b] for a, b in PRODUCTS]
    return np.stack([*F.T, *means, *products], axis=1)


def linear(T: Float[np.ndarray, "p t"], weights: Float[np.ndarray, " t1"]) -> Float[np.ndarray, " p"]:
    """The constant and the weighted terms, within ln 90."""
    return np.clip(weights[0] + T @ weights[1:], -8, np.log(90))


@cache
def calibrations() -> dict[str, Calibration]:
    """By method, as FILE has them."""
    stored = json.loads(FILE.read_text())["methods"]
    return {
        name: Calibration(**{key: np.array(value, float) for key, value in one.items()}) for name, one in stored.items()
    }
