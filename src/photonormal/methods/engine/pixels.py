"""Networks that see each pixel by itself before they look around: all samples of some pixels at a time.

What is pooled over the images so stays in a processor's cache. Pixels outside the mask all show the same: one of them
stands for all. What looks around computes in float32 on any machine: in bf16 normals would move by 0.03 degrees more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.methods.engine.frames import frames
from photonormal.methods.engine.prior import FirstLook
from photonormal.methods.engine.turns import turned, turned_map
from photonormal.methods.engine.windows import Box, Span, Window
from photonormal.methods.engine.workers import side_by_side
from photonormal.methods.inputs.scaling import scaled
from photonormal.methods.learned.network import Network
from photonormal.methods.learned.processor import inner_precision
from photonormal.types import Capture

AT_A_TIME = {"cpu": 2**13, "cuda": 2**21}  # samples that are encoded


@dataclass(frozen=True)
class Samples:
    """What a window's pixels on the mask show, row by row; one more at the end stands for those outside it.

    Parameters
    ----------
    mask : (h, w)
    I : (p + 1, n) scaled
    pixels : (p,) numbers of the pixels on the capture's mask
    """

    mask: Bool[Tensor, "h w"]
    I: Float[Tensor, "p1 n"]
    pixels: Int[np.ndarray, " p"]
    capture: Capture = field(repr=False)

    @staticmethod
    def of(net: Network, capture: Capture, box: Box, look: FirstLook, window: Window, device: torch.device) -> Samples:
        """Those of a window, each image read once."""
        n, mask = capture.images.shape[0], box.mask[window.seen].to(device)
        moments = look.moments if look.moments.numel() == 1 else look.moments[..., *window.seen]
        I = torch.zeros(int(mask.sum()) + 1, n, device=device)
        for j, images in frames(capture, box, window.seen, device):
            I[:-1, j] = scaled(net.scaling, images, mask[None, None], moments, n)[0, 0, 0][mask]
        return Samples(mask, I, box.pixels(window.seen), capture)

    def within(self, seen: Span) -> Samples:
        """Those of a part of the window."""
        some = torch.zeros_like(self.mask)
        some[seen] = True
        if some.all():
            return self
        some = some[self.mask]
        return replace(
            self,
            mask=self.mask[seen],
            I=self.I[torch.cat([some, some.new_ones(1)])],
            pixels=self.pixels[some.cpu().numpy()],
        )

    def parts(self, samples: int) -> list[slice]:
        """Some pixels after the other, so many samples at a time."""
        step = max(1, samples // self.I.shape[1])
        return [slice(first, first + step) for first in range(0, len(self.I), step)]

    def shown(self, some: slice) -> tuple[Float[Tensor, "1 n 1 1 q"], Float[Tensor, "1 n 3 *1q"]]:
        """Some of the pixels as images of one row, and their lights."""
        known = torch.as_tensor(self.capture.known_lights(), dtype=torch.float32)  # (n, 3)
        I, L = self.I[some].T[None, :, None, None], known[None]
        if self.capture.lights_at is not None:
            each = torch.from_numpy(self.capture.lights_at[self.pixels[some]])
            L = torch.cat([each, L])[: I.shape[-1]].permute(1, 2, 0)[None, :, :, None]
        return I, L.to(I.device)


def one_pass(
    net: Network,
    samples: Samples,
    found: Float[Tensor, "1 d h w"],
    rotations: int,
    advance: Callable[[int], None],
) -> Iterator[Float[Tensor, "1 e h w"]]:
    """What the network tells in each quarter turn, turned back, from the last pass's normals and memory.

    `advance` is told how many samples were looked at.
    """
    n, mask, device = samples.I.shape[1], samples.mask, found.device
    start = torch.cat([found[0, :, mask].T, found.new_zeros(1, found.shape[1])])  # (p + 1, d)

    def digested(some: slice) -> list[Float[Tensor, "q c"]]:
        images, L = samples.shown(some)
        prior, found = start[some].T[None, :, None], []  # (1, d, 1, q)
        with inner_precision(device):
            for quarters in range(rotations):
                lights = turned(L, quarters, 2)
                shared = net.begin(turned(prior, quarters, 1), lights)
                found.append(net.digest(net.encode(images, lights, shared), n, shared)[0, 0])
        advance(images.numel())
        return found

    parts = side_by_side(digested, samples.parts(AT_A_TIME.get(device.type, AT_A_TIME["cuda"])), device)
    turns = [list(turn) for turn in zip(*parts, strict=True)]
    del parts
    number = torch.full(mask.shape, len(start) - 1, device=device)
    number[mask] = torch.arange(len(start) - 1, device=device)
    for quarters in range(rotations):
        shared = net.begin(turned_map(found * mask, quarters), None)
        told = net.look(torch.cat(turns.pop(0))[torch.rot90(number, quarters)[None]].float(), n, shared)
        yield turned_map(told, -quarters)
