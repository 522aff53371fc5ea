"""What a pixel's samples, its object's pictures and the normals around it say about the normal that a method found."""

from __future__ import annotations

from functools import cache, partial
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.masked import picked
from photonormal.methods.bend import bend_deg
from photonormal.methods.classical.trimmed import Trimmed
from photonormal.methods.classical.woodham import (
    pairs,
    scaled_normals,
    symmetric_inverse,
    symmetric_product,
)
from photonormal.methods.engine.samples import Band, all_lights, bands, lights_at
from photonormal.methods.inputs.blocks import blocks
from photonormal.methods.inputs.grey import ascending
from photonormal.methods.inputs.workers import side_by_side
from photonormal.progress import progress
from photonormal.shading import angle_deg, cosines, over_lights, shade
from photonormal.types import Capture, Normals

LEAST_TOLD = 0.1  # degrees that a method estimates: less says nothing
DIM = Trimmed(lowest=0.0, highest=0.35)


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
    sides: Tensor  # ln: degrees between normals of opposite halves of the lights, samples of middle brightness
    halves: Tensor  # ln: degrees between normals of every other light, the same samples
    worst: Tensor  # ln: what the worst tenth of the images leaves unexplained, over the usual one's
    bend: Tensor  # ln: `photonormal.methods.bend`
    slant: Tensor  # ln: n.v
    peak: Tensor  # ln: brightest sample over the mean lit one
    level: Tensor  # ln: mean lit sample, over that of the object's bright parts
    evenness: Tensor  # mean root over the root of the mean, of lit samples
    images: Tensor  # ln: their number
    told: Tensor  # ln: degrees that the method itself expects, or 0


EVIDENCE = Evidence._fields


def evidence_of(
    capture: Capture,
    normals: Normals,
    device: torch.device,
    told_deg: Float[np.ndarray, "h w"] | None = None,
    some: Bool[np.ndarray, "h w"] | None = None,
    bent_deg: Float[np.ndarray, "h w"] | None = None,
) -> Float[Tensor, "p k"]:
    """`Evidence` of every pixel that has a normal, or of some of them, and what the method estimates itself."""
    some = normals.mask if some is None else some
    bent_deg = bend_deg(normals) if bent_deg is None else bent_deg
    L = all_lights(capture, device, torch.float32)
    N, v = torch.from_numpy(picked(normals.map, some)).to(device), to_camera(capture, some).to(device)

    @cache
    def numbers() -> Int[np.ndarray, " q"]:  # on the capture's mask
        return np.flatnonzero(some[capture.mask])

    def told(band: Band, s: slice) -> tuple[Float[Tensor, "b k"], Float[Tensor, "2 n"]]:
        I = band.I[s].to(device)
        at = slice(band.first + s.start, band.first + s.start + len(I))
        lights = lights_at(capture, numbers()[at], device) if L is None else L
        found, unexplained = evidence(I, band.levels.lit(I), lights, N[at], v[at])
        return torch.stack(found, dim=1), unexplained

    parts = []
    with progress("expected errors", len(N)) as advance:
        for band in bands(capture, L, some=some):
            band.levels.cut_(band.I)
            parts += side_by_side(partial(told, band), blocks(len(band.I), band.I.shape[1], device), device)
            advance(len(band.I))
    F = torch.nan_to_num(torch.cat([found for found, _ in parts]))
    column = {name: F[:, i] for i, name in enumerate(EVIDENCE)}
    bright = np.quantile(column["level"].cpu().numpy(), 0.9)
    column["level"].sub_(bright).clamp_(min=np.log(1e-2))
    column["worst"].fill_(worst_images(torch.stack([unexplained for _, unexplained in parts]).sum(0)))
    column["bend"].copy_(logarithm(torch.from_numpy(picked(bent_deg, some)).to(F), 0.05))
    if told_deg is not None:
        column["told"].copy_(logarithm(torch.from_numpy(picked(told_deg, some)).to(F), LEAST_TOLD))
    return F


def worst_images(unexplained: Float[Tensor, "2 n"]) -> float:
    """ln of what the worst tenth of the images leaves, over the usual one's, from sums of roots and their numbers."""
    total, count = unexplained.double().cpu().numpy()
    left = np.log((total / count.clip(min=1))[count > 0].clip(min=1e-3))
    return 2 * float(np.quantile(left, 0.9) - np.median(left)) if len(left) else 0.0


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
) -> tuple[Evidence, Float[Tensor, "2 n"]]:
    """From the samples to `keep` and the unit normals found; of each image, too, sums of roots of what is left."""
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
    root = use * r.abs().sqrt()
    usual = (root.sum(1) / count.clamp(min=1)) ** 2 * (count.clamp(min=1) / free).sqrt()
    shine = ((use * r.clamp(min=0) ** 2).sum(1) / free).sqrt()
    lit_count = keep.to(I.dtype).sum(1).clamp(min=1)
    mean = (I * keep).sum(1) / lit_count
    ranked = ascending(I)
    middle, dim = (keep & rule.window(I, keep, ranked) for rule in (Trimmed(), DIM))
    plain = scaled_normals(I, L)
    right, above = opposite(L)
    halves = [one for half in (right, above, every_other(L)) for one in (half, ~half)]
    trimmed, *apart = least_squares(I, middle, L, torch.stack([torch.ones_like(right), *halves]), plain).unbind(1)
    (dimmer,) = least_squares(I, dim, L, torch.ones_like(right)[None], plain).unbind(1)
    beside, over, between = (angle_deg(a, b) for a, b in zip(apart[::2], apart[1::2], strict=True))
    told = Evidence(
        residual=logarithm(residual, 1e-3).clamp(max=2),
        usual_residual=logarithm(usual, 1e-3).clamp(max=2),
        shine=logarithm(shine, 1e-3).clamp(max=2),
        cast_shadow=(~keep & (cos > 0.1)).to(I.dtype).mean(1),
        contradiction=(keep & (cos <= 0)).to(I.dtype).mean(1),
        lit=keep.to(I.dtype).mean(1),
        uncertainty=uncertainty(use, L, N).log(),
        woodham=logarithm(angle_deg(N, plain), 0.1),
        trimmed=logarithm(angle_deg(N, trimmed), 0.1),
        dim=logarithm(angle_deg(N, dimmer), 0.1),
        sides=logarithm(((beside**2 + over**2) / 2).sqrt(), 0.1),
        halves=logarithm(between, 0.05),
        worst=torch.zeros_like(mean),  # of all pixels together
        bend=torch.zeros_like(mean),  # of the normals around
        slant=logarithm((N * v).sum(1), 0.05),
        peak=logarithm(I.amax(1) / mean.clamp(min=1e-9), 1.0).clamp(max=4),
        level=logarithm(mean, 1e-9),
        evenness=(I * keep).sqrt().sum(1) / lit_count / mean.clamp(min=1e-9).sqrt(),
        images=torch.full_like(mean, I.shape[1]).log(),
        told=torch.zeros_like(mean),
    )
    return told, torch.stack([root.sum(0), use.sum(0)])


def least_squares(
    I: Float[Tensor, "p n"],
    keep: Bool[Tensor, "p n"],
    L: Float[Tensor, "*l n 3"],
    ways: Bool[Tensor, "k n"],
    plain: Float[Tensor, "p 3"],
) -> Float[Tensor, "p k 3"]:
    """Normals, of any length, of the samples to `keep` under some of the lights, by each of the `ways`; where those do
    not fix a normal it is `plain`."""
    w, some = keep.to(I.dtype), ways.to(I.dtype).T[..., None]  # (n, k, 1)
    A = over_lights(w, (some * pairs(L)[..., None, :]).flatten(-2)).unflatten(-1, (-1, 6))
    y = over_lights(w * I, (some * L[..., None, :]).flatten(-2)).unflatten(-1, (-1, 3))
    inverse, fixed = symmetric_inverse(A)
    return torch.where(fixed, symmetric_product(inverse, y), plain[:, None])


def opposite(L: Float[Tensor, "*l n 3"]) -> Bool[Tensor, "2 n"]:
    """Halves of the lights, right and above."""
    xy = L.reshape(-1, *L.shape[-2:]).mean(0)[:, :2]
    return (xy >= xy.median(0).values).T


def every_other(L: Float[Tensor, "*l n 3"]) -> Bool[Tensor, " n"]:
    """Every other light in the order of their directions, so that both halves come from everywhere."""
    place = L.reshape(-1, *L.shape[-2:]).mean(0) @ L.new_tensor([0.8, 0.6, 0.0])
    return place.argsort().argsort() % 2 == 0


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
