"""Networks that see each pixel by itself before they look around: all samples of some pixels at a time.

What is pooled over the images so stays in a processor's cache. Pixels outside the mask all show the same: one of them
stands for all.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.methods.engine.frames import frames
from photonormal.methods.engine.task import Task
from photonormal.methods.engine.turns import turned
from photonormal.methods.engine.windows import Span
from photonormal.methods.inputs.scaling import scaled
from photonormal.methods.inputs.workers import side_by_side
from photonormal.methods.learned.network import PixelNetwork
from photonormal.methods.learned.processor import PICTURES, inner_precision
from photonormal.types import Capture

AT_A_TIME = {"cpu": 2**13, "cuda": 2**21}  # samples that are encoded


@dataclass(frozen=True)
class PixelSamples:
    """What the pixels on the mask of a part of the box show, row by row; all that follow stand for those outside.

    Parameters
    ----------
    mask : (h, w)
    I : (q, n) scaled; q > p is so many that equally many are always looked at together
    pixels : (p,) their numbers on the capture's mask, where lights differ from pixel to pixel
    """

    mask: Bool[Tensor, "h w"]
    I: Float[Tensor, "q n"]
    capture: Capture = field(repr=False)
    pixels: Int[np.ndarray, " p"] | None

    @staticmethod
    def of(net: PixelNetwork, task: Task, seen: Span) -> PixelSamples:
        """Those of a part, each image read once."""
        capture, box, look, device = task.capture, task.box, task.look, task.device
        n, mask = capture.images.shape[0], box.mask[seen].to(device)
        moments = look.moments if look.moments.numel() == 1 else look.moments[..., *seen]
        p, step = int(mask.sum()), _together(n, device)
        I = torch.zeros((p // step + 1) * step, n, device=device)
        for j, images in frames(capture, box, seen, device):
            I[:p, j] = scaled(net.scaling, images, mask[None, None], moments, n)[0, 0, 0][mask]
        return PixelSamples(mask, I, capture, None if capture.lights_at is None else box.pixels(seen))

    def parts(self) -> list[slice]:
        """Some pixels after the other."""
        step = _together(self.I.shape[1], self.I.device)
        return [slice(first, first + step) for first in range(0, len(self.I), step)]

    def shown(self, some: slice) -> tuple[Float[Tensor, "1 n 1 1 q"], Float[Tensor, "1 n 3 *1q"]]:
        """Some of the pixels as images of one row, and their lights."""
        known = torch.as_tensor(self.capture.known_lights(), dtype=torch.float32)  # (n, 3)
        I, L = self.I[some].T[None, :, None, None], known[None]
        if self.capture.lights_at is not None and self.pixels is not None:
            each = torch.from_numpy(self.capture.lights_at[self.pixels[some]])
            L = torch.cat([each, L.expand(I.shape[-1] - len(each), -1, -1)]).permute(1, 2, 0)[None, :, :, None]
        return I, L.to(I.device)


def _together(n: int, device: torch.device) -> int:
    """Pixels of n samples that are encoded together: so many that `of_rows` is fast."""
    return max(PICTURES, AT_A_TIME.get(device.type, AT_A_TIME["cuda"]) // n // PICTURES * PICTURES)


def digested(
    net: PixelNetwork, task: Task, samples: PixelSamples, found: Float[Tensor, "d h w"]
) -> list[Float[Tensor, "1 h w c"]]:
    """What each pixel knows of its images in each quarter turn, from the last pass's normals and memory."""
    n, mask, device = samples.I.shape[1], samples.mask, found.device
    inside = found[:, mask].T  # (p, d)
    p = len(inside)
    start = torch.cat([inside, inside.new_zeros(len(samples.I) - p, len(found))])

    def digested(some: slice) -> list[Float[Tensor, "q c"]]:
        images, L = samples.shown(some)
        prior, found = start[some].T[None, :, None], []  # (1, d, 1, q)
        with inner_precision(device, net.exact):
            for quarters in range(task.rotations):
                lights = turned(L, quarters, 2)
                shared = net.begin(turned(prior, quarters, 1), lights)
                found.append(net.digest(net.encode(images, lights, shared), n, shared)[0, 0])
        task.advance(n * (min(some.stop, p) - min(some.start, p)))  # those outside are none
        return found

    parts = side_by_side(digested, samples.parts(), device)
    turns = [list(turn) for turn in zip(*parts, strict=True)]
    del parts
    number = torch.full(mask.shape, p, device=device)
    number[mask] = torch.arange(p, device=device)
    return [torch.cat(turns.pop(0))[number[None]] for _ in range(task.rotations)]
