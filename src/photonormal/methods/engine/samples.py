"""Methods that are shown samples: grey levels of some rows of the mask at a time, or of all, and what they find."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.masked import box_of, grid_bands, row_bands
from photonormal.methods.contract import Observations, Solution, Solver
from photonormal.methods.engine import plan
from photonormal.methods.inputs.blocks import blocks
from photonormal.methods.inputs.grey import Levels, grey_samples, metallic, telling
from photonormal.methods.inputs.workers import side_by_side
from photonormal.progress import progress
from photonormal.types import Capture


def by_pixel(method: Solver, capture: Capture, device: torch.device, rows: slice | None = None) -> Solution:
    """What a method finds that treats each pixel by itself: rows by rows, and block by block of them."""
    rows = rows or slice(0, len(capture.mask))
    dtype = torch.float64 if method.needs.double else torch.float32
    L = all_lights(capture, device, dtype)

    before, p = (int(np.count_nonzero(capture.mask[some])) for some in (slice(0, rows.start), rows))
    normals = torch.zeros(p, 3)  # filled as they come: joining parts would hold them twice

    def solved(band: Band, s: slice) -> Float[Tensor, " q"] | None:
        I, at = band.I[s], slice(band.first + s.start, band.first + min(s.stop, len(band.I)))
        lights = lights_at(capture, at, device, dtype) if L is None else L
        found = method(Observations(I.to(device, dtype), band.levels.lit(I).to(device), lights, band.is_metallic)).cpu()
        normals[at.start - before : at.stop - before] = found.normals
        advance(len(I))
        return found.told_deg

    told = []
    with progress("normals", p) as advance:
        for band in bands(capture, L, rows):
            band.levels.cut_(band.I)
            told += side_by_side(partial(solved, band), blocks(band.I.shape[0], band.I.shape[1], device), device)
    return Solution(normals, None if told[0] is None else torch.cat(told))


def whole_object(method: Solver, capture: Capture, device: torch.device) -> Solution:
    """What a method finds that looks at all samples at once, which stay in main memory; lights are on the device."""
    dtype = torch.float64 if method.needs.double else torch.float32
    I = grey_levels(capture)
    levels = Levels.of(I)
    keep = levels.lit(levels.cut_(I))
    L = None if capture.lights is None else lights_of(capture, device, dtype)

    def is_metallic() -> bool:
        return L is not None and metallic(I, keep, L)

    seen = Observations(I, keep, L, is_metallic, torch.from_numpy(capture.mask), lambda: pictures(capture, device))
    with progress("normals"):
        return method(seen).cpu()


class Band(NamedTuple):
    """Some rows of the mask, and what is known of the whole capture."""

    I: Float[Tensor, "p n"]  # grey levels, not cut
    first: int  # number of the first pixel, among all or those chosen
    levels: Levels
    is_metallic: Callable[[], bool]


def bands(
    capture: Capture,
    L: Float[Tensor, "n 3"] | None,
    within: slice = slice(None),
    some: Bool[np.ndarray, "h w"] | None = None,
) -> Iterator[Band]:
    """Some rows after the other, no more than those `within`; of `some` pixels, in place of all on the mask."""
    whole = capture.mask if some is None else some
    mask = np.zeros_like(whole)
    mask[within] = whole[within]
    lines = np.flatnonzero(mask.any(1))
    parts = row_bands(mask[lines], plan.pixels(capture))
    rows = [slice(lines[part.start], lines[part.stop - 1] + 1) for part in parts]
    first = int(whole[: within.start or 0].sum())
    I = grey_levels(capture, whole, rows[0])
    tell = telling(whole, I.shape[1])
    told = I[np.flatnonzero(tell[whole])] if len(I) == whole.sum() else grey_levels(capture, tell)
    levels = Levels.of(told)
    cut = levels.cut_(told)

    @cache
    def is_metallic() -> bool:
        pixels = np.flatnonzero(tell[capture.mask])
        lights = lights_at(capture, pixels, torch.device("cpu")) if L is None else L
        return metallic(cut, levels.lit(cut), lights)

    for k, span in enumerate(rows):
        if k:
            del I  # before the next is read
            I = grey_levels(capture, whole, span)
        yield Band(I, first, levels, is_metallic)
        first += len(I)


def grey_levels(
    capture: Capture, some: Bool[np.ndarray, "h w"] | None = None, within: slice = slice(None)
) -> Float[Tensor, "p n"]:
    """Grey level of each mask pixel, or of `some` of them, in each image; float32 on the processor, not cut.

    `within`: in these rows only.
    """
    mask, columns = np.zeros_like(capture.mask), box_of(capture.mask)[1]
    mask[within] = (capture.mask if some is None else some)[within]
    spans = grid_bands(mask)  # a window of a whole frame would be large
    pixels = [np.flatnonzero(mask[span, columns]) for span in spans]
    I = np.empty((sum(map(len, pixels)), capture.images.shape[0]), np.float32)

    def read(j: int) -> None:
        first = 0
        for span, inside in zip(spans, pixels, strict=True):
            image = capture.window(j, span, columns)
            I[first : first + len(inside), j] = grey_samples(image.reshape(-1, image.shape[2]).take(inside, axis=0))
            first += len(inside)

    capture.each_image(read)
    return torch.from_numpy(I)


def pictures(capture: Capture, device: torch.device) -> Float[Tensor, "n c h w"]:
    """All images, linear, zero outside the mask."""
    whole = np.s_[: capture.mask.shape[0]], np.s_[: capture.mask.shape[1]]
    found = capture.each_image(lambda j: capture.window(j, *whole) * capture.mask[..., None])
    return torch.from_numpy(np.stack(found)).permute(0, 3, 1, 2).to(device)


def all_lights(capture: Capture, device: torch.device, dtype: torch.dtype) -> Float[Tensor, "n 3"] | None:
    """The lights that all pixels share; None where each sees them elsewhere."""
    return None if capture.lights_at is not None else lights_of(capture, device, dtype)


def lights_at(
    capture: Capture, some: slice | np.ndarray, device: torch.device, dtype: torch.dtype = torch.float32
) -> Float[Tensor, "q n 3"]:
    """The lights as some of the mask's pixels see them."""
    assert capture.lights_at is not None
    return torch.as_tensor(capture.lights_at[some], dtype=dtype, device=device)


def lights_of(capture: Capture, device: torch.device, dtype: torch.dtype) -> Float[Tensor, "*l n 3"]:
    """Light directions: (n, 3), or (p, n, 3) where each of the mask's pixels sees them elsewhere."""
    if capture.lights_at is not None:
        return lights_at(capture, slice(None), device, dtype)
    return torch.as_tensor(capture.known_lights(), dtype=dtype, device=device)
