"""The maps of a capture's materials, some rows at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.files import memory
from photonormal.files.rows import Rows
from photonormal.masked import box_of, row_bands
from photonormal.materials.lobes import (
    BARE,
    ROUGHNESS,
    ReflectanceSamples,
    fitted_lobes,
    likeliest,
    log_likelihood,
    samples,
)
from photonormal.materials.neighbours import RADIUS, company, pooled, smooth
from photonormal.methods.engine import plan
from photonormal.methods.engine.near import seen_as_distant
from photonormal.methods.inputs.workers import side_by_side
from photonormal.progress import progress
from photonormal.types import Capture, Materials, Normals, RowMap, saturated_in

CPU = torch.device("cpu")
PIXELS = 2**10  # whose lobes are computed at a time: they fit into a cache
SHARE = 1 / 8  # of the memory for what is held of some rows at a time:
SAMPLE, FOUND = 6, 240  # bytes of each sample, and of what is found of a pixel on the way
FITTED = ("albedo", "F0", "alone", "told", "certain")
AROUND = 5 * RADIUS  # rows that help to decide: neighbours choose the roughness, if it is known, if metal; blends
SATURATED = 0.995  # of the largest sample, from which one shows too little
MATT = 0.6  # share of the albedo in albedo + F0 above which nothing is a metal,
TINTED = 0.3  # below which it is one where
COLOURED = 0.4  # F0 of the channels differs by this much of the largest
FADES = -1.0, 0.0  # logarithms of what the absence of a highlight may change an albedo by


def materials_of(capture: Capture, normals: Normals) -> Materials:
    """Fit a matt lobe and a highlight to each pixel, whose roughness is the likeliest for it and its like neighbours.

    The view is orthographic. Samples in shadow are left out, and channels that are saturated; light between parts of
    the surface is not modelled. An exposure changes the albedo and F0 alone, and the order of the images nothing.

    Raises
    ------
    InputError
        If the capture has no lights, or a row of its photographs does not fit into the memory that is allowed.
    """
    capture = seen_as_distant(capture, normals)
    capture.known_lights()
    h, w = capture.mask.shape
    found = Materials(*(_empty(shape) for shape in ((h, w, 3), (h, w, 3), (h, w), (h, w))))
    columns = box_of(capture.mask)[1]
    with progress("materials", int(capture.mask.sum())) as advance:
        for rows in row_bands(capture.mask, _pixels(capture)):
            around = slice(max(0, rows.start - AROUND), min(h, rows.stop + AROUND))
            _fill(found, capture, normals, rows, around, columns)
            advance(int(capture.mask[rows].sum()))
    return found


def _empty(shape: tuple[int, ...]) -> RowMap:
    """A map where nothing is known: of colours zero, else NaN; on disk where the frame is large."""
    map = Rows(shape, np.float32) if plan.lies_aside(shape[:2], CPU) else np.zeros(shape, np.float32)
    if len(shape) == 2:
        map[:] = np.nan
    return map


def _pixels(capture: Capture) -> int:
    """How many are worked on at a time; InputError if a row of them does not fit into the memory."""
    n, _, _, c = capture.images.shape
    return max(1, min(plan.pixels(capture), int(SHARE * memory.allowed()) // (SAMPLE * n * c + FOUND)))


def _fill(found: Materials, capture: Capture, normals: Normals, rows: slice, around: slice, columns: slice) -> None:
    """The maps in some rows, which those `around` them help to decide."""
    on = normals.mask[around, columns]
    if not on.any():
        return
    seen = list(_seen(capture, normals, around, columns))
    where = torch.from_numpy(on)
    roughness = _roughness(seen, where, capture.images.shape[3])
    parts = zip(seen, roughness.split(PIXELS), strict=True)
    fits = side_by_side(lambda part: fitted_lobes(part[0].samples(), part[1]), parts, CPU)
    rho, F0, alone, told, certain = (torch.cat([getattr(fit, name) for fit in fits]) for name in FITTED)

    def believed(which: Tensor) -> Tensor:
        """Those that have company: a broad highlight reaches a pixel's neighbours, too."""
        some = torch.zeros(on.shape, dtype=torch.bool)
        some[where] = which
        return which & (company(some, where)[where] >= roughness.square())

    told = believed(told)
    two, rho, F0 = rho, torch.where(told[:, None], rho, alone), F0 * told[:, None]
    metal = metalness(rho, F0, certain & told)
    metal = torch.where((metal == 1) & ~believed(metal == 1), torch.nan, metal)
    rho = blended(two, alone, told, metal == 0, where)
    roughness = torch.where(told, roughness, torch.nan)
    kept = np.zeros_like(on)
    kept[rows.start - around.start : rows.stop - around.start] = True
    mine = torch.from_numpy(kept[on])
    for map, values in (
        (found.albedo, rho * seen[0].unit),
        (found.specular, F0 * seen[0].unit),
        (found.roughness, roughness),
        (found.metalness, metal),
    ):
        part = map[rows]
        part[:, columns][normals.mask[rows, columns]] = values[mine].numpy()
        map[rows] = part


@dataclass(frozen=True)
class SeenPixels:
    """Radiance in a unit of its own, normals and lights of some pixels, and which samples are saturated, or nearly."""

    unit: float
    I: Float[Tensor, "p n c"]
    N: Float[Tensor, "p 3"]
    L: Float[Tensor, "n 3"] | Float[Tensor, "p n 3"]
    white: Bool[Tensor, "p n c"]

    def samples(self) -> ReflectanceSamples:
        return samples(self.I, self.N, self.L, self.white)


def _seen(capture: Capture, normals: Normals, rows: slice, columns: slice) -> Iterator[SeenPixels]:
    """What is seen of the normals' pixels in a window, some at a time."""
    on, asked = normals.mask[rows, columns], capture.mask[rows, columns]
    I = torch.from_numpy(capture.samples(rows, columns, on))  # (p, n, c)
    level = np.inf if capture.saturation is None else np.asarray(capture.saturation, np.float32)
    white = I >= torch.as_tensor(SATURATED * level)  # (p, n, c)
    for j in range(I.shape[1]):
        if (told := saturated_in(capture.images, j, rows, columns)) is not None:
            white[:, j] = torch.from_numpy(told[on])
    unit = max(float(I.mean()), 0) or 1.0
    I /= unit
    N = torch.from_numpy(normals.map[rows, columns][on])
    numbers = int(np.count_nonzero(capture.mask[: rows.start])) + np.flatnonzero(on[asked])  # on the capture's mask
    lights = torch.from_numpy(capture.known_lights().astype(np.float32))
    for first in range(0, len(I), PIXELS):
        part = slice(first, first + PIXELS)
        if capture.lights_at is not None:
            lights = torch.from_numpy(np.asarray(capture.lights_at[numbers[part]], np.float32))
        yield SeenPixels(unit, I[part], N[part], lights, white[part])


def _roughness(seen: list[SeenPixels], where: Bool[Tensor, "h w"], channels: int) -> Float[Tensor, " p"]:
    """The likeliest one of each pixel and its neighbours."""
    likelihood, colour = torch.zeros(*where.shape, len(ROUGHNESS)), torch.zeros(*where.shape, channels)
    numbers = where.flatten().nonzero()[:, 0].split(PIXELS)

    def guess(part: tuple[SeenPixels, Tensor]) -> None:
        s = part[0].samples()
        likelihood.view(-1, len(ROUGHNESS))[part[1]] = log_likelihood(s)
        colour.view(-1, channels)[part[1]] = s.albedo

    def choose(rows: slice) -> Tensor:
        around = slice(max(0, rows.start - RADIUS), rows.stop + RADIUS)
        mine = slice(rows.start - around.start, rows.stop - around.start)
        return likeliest(pooled(likelihood[around], colour[around], mine)[where[rows]])

    side_by_side(guess, zip(seen, numbers, strict=True), CPU)
    return torch.cat(side_by_side(choose, row_bands(where.numpy(), PIXELS), CPU))


def blended(
    rho: Float[Tensor, "p c"],
    alone: Float[Tensor, "p c"],
    told: Bool[Tensor, " p"],
    matt: Bool[Tensor, " p"],
    where: Bool[Tensor, "h w"],
) -> Float[Tensor, "p c"]:
    """The albedo, `rho` where it is known, else `alone`, which fades where both meet: a highlight does not end where it
    is no longer known.

    By what it brightens told ones, the `matt` ones among them, it brightens untold ones near them, the less the farther
    they are off, and not more than their own samples say.
    """
    own = (rho.clamp(min=1e-9) / alone.clamp(min=1e-9)).log().clamp(*FADES)
    map = torch.zeros(own.shape[1] + 2, *where.shape)
    map[:, where] = torch.cat([torch.where(matt[:, None], own, 0).T, matt[None].float(), torch.ones(1, len(told))])
    *total, share, on = smooth(map)[:, where]
    weight = (2 * share / on).clamp(max=1) / share.clamp(min=1e-6)  # together 1 at a straight edge
    fade = torch.stack(total, 1) * weight[:, None]
    return torch.where(told[:, None], rho, alone * torch.maximum(fade, own).exp())


def metalness(rho: Float[Tensor, "p c"], F0: Float[Tensor, "p c"], certain: Bool[Tensor, " p"]) -> Float[Tensor, " p"]:
    """1 where there is certainly no matt part, or little of it under a coloured highlight; 0 where there is one; else
    NaN: light that comes from other parts, and shadows, hide a matt part, but fit no highlight well."""
    matt, bright = rho.mean(-1), F0.mean(-1)
    share = matt / (matt + bright).clamp(min=1e-12)
    coloured = F0.amax(-1) - F0.amin(-1) > COLOURED * F0.amax(-1)
    metal = certain & ((share < BARE) | ((share < TINTED) & coloured))
    nan = torch.full_like(share, torch.nan)
    return torch.where(metal, 1.0, torch.where((bright > 0) & (share > MATT), 0.0, nan))
