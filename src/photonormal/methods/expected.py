"""How far each normal is expected to be off, in degrees.

What a pixel's samples say about its normal is put into a few numbers (`evidence`): how well a matt surface of that
normal explains them, how much lies in shadow, how well the lights fix a normal, how far two cheap methods disagree;
and what the method itself tells, where a network does. A calibration of each method, fitted to rendered scenes
(`benchmarks/expected.py --fit`), maps them to a mean error. Of a real object its true normals are known no better than
its scan lies on its pictures, which rendered ones can't teach: where the surface turns, that adds to the error.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.masked import on_map, taken
from photonormal.methods import name_of, options_of, parse
from photonormal.methods.bend import bend_deg
from photonormal.methods.between import between
from photonormal.methods.classical.trimmed import Trimmed
from photonormal.methods.classical.woodham import Woodham, pairs, symmetric_inverse, symmetric_product
from photonormal.methods.contract import Method
from photonormal.methods.engine.near import seen_as_distant
from photonormal.methods.engine.samples import Band, all_lights, bands, lights_at
from photonormal.methods.engine.workers import side_by_side
from photonormal.methods.inputs.blocks import blocks
from photonormal.shading import angle_deg, cosines, over_lights, shade
from photonormal.types import Capture, Normals

FILE = Path(__file__).with_name("expected.json")


class Evidence(NamedTuple):
    """What a pixel's samples say about its normal; each (p,), finite."""

    residual: Tensor  # ln: root mean square of what the Lambertian fit leaves, over the fit; lit samples, n.l > 0
    usual_residual: Tensor  # ln: the same of most samples, a mean that outliers hardly move
    shine: Tensor  # ln: root mean square of what exceeds the fit
    cast_shadow: Tensor  # share of the samples that the normal says are lit but are dark
    contradiction: Tensor  # share that the normal says are dark but are lit
    lit: Tensor  # share
    uncertainty: Tensor  # ln: error of the normal, radians, for an error of the samples as large as the samples
    woodham: Tensor  # ln: degrees to the least-squares normal
    trimmed: Tensor  # ln: degrees to the normal of the samples of middle brightness
    dim: Tensor  # ln: degrees to the normal of the dimmer samples
    slant: Tensor  # ln: n.v
    peak: Tensor  # ln: brightest sample over the mean lit one
    level: Tensor  # ln: mean lit sample, over that of the object's bright parts
    evenness: Tensor  # mean root over the root of the mean, of lit samples
    images: Tensor  # ln: their number
    told: Tensor  # ln: degrees that the method itself expects, or 0


EVIDENCE = Evidence._fields
OF_ALL = ("usual_residual", "trimmed", "woodham", "uncertainty")  # means over the object count, too
PRODUCTS = (  # that are terms, too
    *((name, name) for name in ("usual_residual", "woodham", "trimmed", "uncertainty", "slant")),
    ("usual_residual", "trimmed"),
    ("trimmed", "uncertainty"),
)
FITTED = 3, 100  # images of the scenes that calibrations were fitted to
EVERY, SPARSEST = 2**16, 4  # pixels up to which each one's error is found; rows and columns between them at most
LARGEST = 2**22  # pixels whose evidence is held; of larger objects so many
SHIFT = 0.35  # by which a real object's true normals lie beside its pictures, in parts of its size, `bend.PART`
LEAST_TOLD = 0.1  # degrees that a method tells: less says nothing
PIXELS = 2**20  # whose terms are held at a time
DIM = Trimmed(lowest=0.0, highest=0.35)


def with_expected_error(
    normals: Normals,
    told_deg: Float[Tensor, " p"] | None,
    capture: Capture,
    method: Method,
    device: torch.device,
    shift: float = SHIFT,
) -> Normals:
    """The normals that a method found, with how far each is expected to be off.

    By the method's calibration; where it has none for these options, what the method tells itself, `told_deg` of the
    pixels on the capture's mask, if it does.
    `capture` is the one that was solved, or that one with its near lamps evened out
    (`photonormal.methods.engine.near.seen_as_distant`), which saves doing it again. `shift` is 0 where true normals
    are exact, as rendered ones are.
    """
    told_map = None if told_deg is None else on_map(told_deg.numpy(), capture.mask, np.nan)
    calibration = calibration_of(method)
    if calibration is None:
        return normals if told_map is None else replace(normals, expected_error_deg=told_map)
    step = grid_step(int(normals.mask.sum()), method.needs.reads == "pixels")
    some = np.zeros_like(normals.mask)
    some[::step, ::step] = normals.mask[::step, ::step]
    if not some.any():
        some, step = normals.mask, 1
    F = evidence_of(seen_as_distant(capture, normals), normals, device, told_map, some)
    found = on_map(calibration(F.cpu().numpy()), some, np.nan)
    if step > 1 and told_map is None:
        found = between(found, normals.mask, step)
    if step > 1 and told_map is not None:
        told_map = told_map.clip(LEAST_TOLD)  # it differs from pixel to pixel; how far to trust it does not
        found = told_map * between(found / told_map, normals.mask, step)
    shifted = bend_deg(normals)
    shifted *= shift
    return replace(normals, expected_error_deg=np.hypot(found, shifted, out=shifted).clip(max=90, out=shifted))


def grid_step(pixels: int, fast: bool) -> int:
    """Rows and columns between the pixels whose errors are found apart.

    So that this costs less than a fast method; else so that what is known of them all at once fits into the memory.
    """
    return min(SPARSEST, int(np.ceil(np.sqrt(pixels / EVERY)))) if fast else int(np.ceil(np.sqrt(pixels / LARGEST)))


def evidence_of(
    capture: Capture,
    normals: Normals,
    device: torch.device,
    told_deg: Float[np.ndarray, "h w"] | None = None,
    some: Bool[np.ndarray, "h w"] | None = None,
) -> Float[Tensor, "p k"]:
    """`Evidence` of every pixel that has a normal, or of some of them, and what the method tells itself."""
    some = normals.mask if some is None else some
    chosen = taken(some, capture.mask)
    L = all_lights(capture, device, torch.float32)
    N, v = torch.from_numpy(taken(normals.map, some)).to(device), to_camera(capture, some).to(device)

    def told(band: Band, here: Int[np.ndarray, " q"], done: int, s: slice) -> Float[Tensor, "b k"]:
        I = band.I[torch.from_numpy(here[s])].to(device)
        lights = lights_at(capture, band.first + here[s], device) if L is None else L
        at = slice(done + s.start, done + s.start + len(I))
        return torch.stack(evidence(I, band.levels.lit(I), lights, N[at], v[at]), dim=1)

    parts, done = [], 0
    for band in bands(capture, L):
        band.levels.cut_(band.I)
        here = np.flatnonzero(chosen[band.first : band.first + len(band.I)])
        parts += side_by_side(partial(told, band, here, done), blocks(len(here), band.I.shape[1], device), device)
        done += len(here)
    F = torch.nan_to_num(torch.cat(parts))
    level = F[:, EVIDENCE.index("level")]
    bright = np.quantile(level.cpu().numpy(), 0.9)
    level.copy_((level - bright).clamp(min=np.log(1e-2)))
    if told_deg is not None:
        F[:, EVIDENCE.index("told")] = logarithm(torch.from_numpy(taken(told_deg, some)).to(F), LEAST_TOLD)
    return F


def to_camera(capture: Capture, some: Bool[np.ndarray, "h w"]) -> Float[Tensor, "p 3"]:
    """Unit vectors to the camera from the surface of some pixels."""
    if capture.camera is None or capture.camera.K is None:
        return torch.tensor([0.0, 0.0, 1.0]).expand(int(some.sum()), 3)
    rays = torch.from_numpy(-capture.camera.rays(*some.shape)[some]).float()
    return rays / rays.norm(dim=-1, keepdim=True)


def evidence(
    I: Float[Tensor, "p n"],
    keep: Bool[Tensor, "p n"],
    L: Float[Tensor, "*l n 3"],
    N: Float[Tensor, "p 3"],
    v: Float[Tensor, "p 3"],
) -> Evidence:
    """From the samples to `keep` and the unit normals found."""
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
    return Evidence(
        residual=logarithm(residual, 1e-3).clamp(max=2),
        usual_residual=logarithm(usual, 1e-3).clamp(max=2),
        shine=logarithm(shine, 1e-3).clamp(max=2),
        cast_shadow=(~keep & (cos > 0.1)).to(I.dtype).mean(1),
        contradiction=(keep & (cos <= 0)).to(I.dtype).mean(1),
        lit=keep.to(I.dtype).mean(1),
        uncertainty=uncertainty(use, L, N).log(),
        woodham=logarithm(angle_deg(N, Woodham().normals(I, L)), 0.1),
        trimmed=logarithm(angle_deg(N, Trimmed().fit(I, keep, L)), 0.1),
        dim=logarithm(angle_deg(N, DIM.fit(I, keep, L)), 0.1),
        slant=logarithm((N * v).sum(1), 0.05),
        peak=logarithm(I.amax(1) / mean.clamp(min=1e-9), 1.0).clamp(max=4),
        level=logarithm(mean, 1e-9),
        evenness=(I * keep).sqrt().sum(1) / lit_count / mean.clamp(min=1e-9).sqrt(),
        images=torch.full_like(mean, I.shape[1]).log(),
        told=torch.zeros_like(mean),
    )


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
        k = min(int(place), max(0, len(self.images) - 2))
        after = min(k + 1, len(self.images) - 1)
        found = []
        for first in range(0, len(F), PIXELS):
            part = F[first : first + PIXELS].astype(np.float64)
            part[:, images] = part[:, images].clip(*np.log(FITTED))
            T = terms(part, F)
            low, high = (np.interp(linear(T, self.weights[i]), *self.curve[i]) for i in (k, after))
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


@dataclass(frozen=True)
class MadeFor:
    """What a calibration holds for: a method with these options, and weights."""

    options: dict[str, Any]
    weights_sha256: str | None

    @staticmethod
    def of(method: Method) -> MadeFor:
        """A method as it is."""
        return MadeFor(options_of(method), getattr(method, "weights_sha256", None))


def calibration_of(method: Method) -> Calibration | None:
    """The calibration of a method; None where there is none for its options and weights."""
    made = MadeFor.of(method)
    fitting = (text for text, one in made_for().items() if one == made and parse(text)[0] == name_of(method))
    return next((calibrations()[text] for text in fitting), None)


@cache
def _stored() -> dict[str, dict[str, Any]]:
    return json.loads(FILE.read_text())["methods"]


@cache
def calibrations() -> dict[str, Calibration]:
    """By method with options, as ``method:option=value``, as FILE has them."""
    return {
        text: Calibration(*(np.array(one[key], float) for key in ("images", "weights", "curve")))
        for text, one in _stored().items()
    }


@cache
def made_for() -> dict[str, MadeFor]:
    """The same, what each calibration holds for."""
    return {text: MadeFor(**one["made_for"]) for text, one in _stored().items()}
