"""A network at half the resolution, whose correction of a classical method is carried to the full one.

The classical normals keep the detail between pixels, the network bends the slopes; where it bends them far, what the
classical method says between pixels counts for little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional as F

from photonormal.files import memory
from photonormal.methods.contract import Solution, Streaming
from photonormal.methods.engine.prior import first_look, prior_named
from photonormal.methods.engine.stream import measured
from photonormal.methods.engine.windows import Box
from photonormal.methods.inputs.grey import grey
from photonormal.methods.learned.layers import unit
from photonormal.types import Capture, Image, LightsAt

# the network's at half the resolution: pixels there mix what few lights reach with what many do
PRIOR = "l1:steps=8"  # twelve change no mean error of a real object by more than 0.013 degrees
BENT_DEG = 12.0  # by which normals are bent where their detail counts for 1 / e
SHARE = 8  # halved pictures are kept where this part of the memory holds them; else made again for each look
ROWS = 256  # of half the resolution, carried at a time


def halved(method: Streaming, capture: Capture, device: torch.device) -> Solution:
    """What a method's network gives at half the resolution, carried to the full one."""
    net, box = method.network(), Box.of(capture, 2)
    look = first_look(net.scaling, capture, box, device, prior_named(method.prior or net.config.prior))
    small = half_of(capture, box, in_grey=net.scaling == "grey")
    found = measured(net, small, device, method.rotations, prior=method.prior or PRIOR, passes=method.passes)
    expected_deg = found.normals.new_ones(len(found.normals), 1) if found.told_deg is None else found.told_deg[:, None]
    coarse = torch.zeros(4, *small.mask.shape)
    coarse[:, torch.from_numpy(small.mask)] = torch.cat([found.normals, expected_deg], dim=1).T
    full = carried(coarse, look.prior[slice(None), slice(None)].cpu(), box.mask)
    full[:3] *= look.lit.cpu()
    values = box.on_mask(full)  # (p, 4)
    return Solution(values[:, :3].clone(), None if found.told_deg is None else values[:, 3].clone())


def half_of(capture: Capture, box: Box, in_grey: bool = False) -> Capture:
    """The box of a capture at half the resolution: means over the pixels on the mask, or of grey levels, two by two."""
    inside = _by_two(box.mask)  # (i, 2, j, 2)
    images = Halved(capture, box, in_grey)
    if SHARE * 4 * math.prod(images.shape) <= memory.allowed():
        images = np.stack(capture.each_image(images.__getitem__))
    lights_at = capture.lights_at
    if lights_at is not None:
        number = torch.cumsum(box.mask.flatten(), 0).view(box.mask.shape) - 1
        first = _by_two(number).masked_fill(~inside, len(number.view(-1))).amin((1, 3))  # (i, j)
        lights_at = Some(lights_at, first[inside.any(3).any(1)].numpy())
    return replace(
        capture,
        images=images,
        mask=inside.any(3).any(1).numpy(),
        lights_at=lights_at,
        truth=None,
        camera=None,
        crop=None,
    )


@dataclass(frozen=True)
class Some:
    """Lights as some pixels see them (`photonormal.types.LightsAt`)."""

    lights: LightsAt
    chosen: np.ndarray

    def __getitem__(self, pixels: Any, /) -> np.ndarray:
        return self.lights[self.chosen[pixels]]


class Halved:
    """Pictures of a box at half the resolution (`photonormal.types.Images`), or grey ones; zero outside the mask."""

    def __init__(self, capture: Capture, box: Box, in_grey: bool = False) -> None:
        self.capture, self.box, self.in_grey = capture, box, in_grey
        (n, _, _, c), (h, w) = capture.images.shape, box.mask.shape
        self.shape = (n, h // 2, w // 2, 1 if in_grey else c)
        self.share = _mean(box.mask.float()[None])[0].clamp(min=0.25)  # (i, j) of the pixels, on the mask

    def __getitem__(self, j: int, /) -> Image:
        return self.window(j, slice(None), slice(None))

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of one picture."""
        if (rows.step or 1) > 1:
            return self.window(j, slice(rows.start, rows.stop), columns)[:: rows.step]
        (top, bottom, _), (left, right, _) = rows.indices(self.shape[1]), columns.indices(self.shape[2])
        seen = slice(2 * top, 2 * bottom), slice(2 * left, 2 * right)
        part = self.box.read(self.capture, j, seen)
        part = (grey(part) if self.in_grey else part)[0, 0].mul_(self.box.mask[seen])  # (c, h, w)
        return _mean(part).div_(self.share[rows, columns]).permute(1, 2, 0).numpy()


def carried(
    coarse: Float[Tensor, "d i j"], fine: Float[Tensor, "3 h w"], mask: Bool[Tensor, "h w"]
) -> Float[Tensor, "d h w"]:
    """Normals of half the resolution, and what follows them, at the full one, with the detail of `fine` normals.

    Detail is what `fine` differs by from itself at half the resolution. What is zero is not known.
    """
    small = _by_two(mask).any(3).any(1)  # (i, j)
    means = unit(_mean(fine), axis=0)
    both = torch.cat([coarse, means]) * small
    found = torch.empty(len(coarse), *mask.shape)
    for top in range(0, len(small), ROWS):
        bottom = min(top + ROWS, len(small))
        around = slice(max(0, top - 1), min(len(small), bottom + 1))
        at = slice(2 * (top - around.start), 2 * (bottom - around.start))
        here = _doubled(both[:, around], small[around])[:, at]
        rows = slice(2 * top, 2 * bottom)
        N, C, detail = unit(here[:3], axis=0), unit(here[-3:], axis=0), fine[:, rows]
        bent_deg = torch.rad2deg(2 * torch.asin((N - C).square().sum(0).sqrt().div(2).clamp(max=1)))
        counts = torch.exp(-bent_deg / BENT_DEG) * detail.any(0) * here[-3:].any(0)
        found[:3, rows] = unit(N + counts * (detail - C), axis=0)
        found[3:, rows] = here[3:-3]
    return found


def _by_two(v: Tensor) -> Tensor:
    """(h, w) as (i, 2, j, 2)."""
    h, w = v.shape
    return v.view(h // 2, 2, w // 2, 2)


def _mean(v: Float[Tensor, "d h w"]) -> Float[Tensor, "d i j"]:
    """Over two by two pixels."""
    return F.avg_pool2d(v[None], 2)[0]


def _doubled(v: Float[Tensor, "d i j"], known: Bool[Tensor, "i j"]) -> Float[Tensor, "d h w"]:
    """At twice the resolution, between the pixels that are known."""
    both = torch.cat([v, known[None].to(v.dtype)])[None]
    both = F.interpolate(both, scale_factor=2, mode="bilinear")[0]
    return both[:-1] / both[-1].clamp(min=1e-6)
