"""Measuring with a network: images streamed one or a few at a time, in windows where the object is large.

Memory does not grow with the number of images and is bounded in the number of pixels. The mask's box alone is computed;
windows overlap by the network's reach, so they agree with the whole to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.contract import Solution, Streaming
from photonormal.methods.engine import plan
from photonormal.methods.engine.frames import frames
from photonormal.methods.engine.prior import FirstLook, first_look, prior_named
from photonormal.methods.engine.windows import Box, Window
from photonormal.methods.inputs.scaling import scaled
from photonormal.methods.learned.network import Network, placed
from photonormal.methods.learned.processor import inner_precision
from photonormal.progress import progress
from photonormal.types import Capture, InputError

PART = 2**13  # pixels of an image that a processor encodes at a time
SEEN = 2**21  # pixels, of all images together, that other devices encode at a time


def streamed(method: Streaming, capture: Capture, device: torch.device) -> Solution:
    """What a network tells of a capture."""
    return measured(
        method.network(), capture, device, method.rotations, prior=method.prior or None, passes=method.passes
    )


def measured(
    net: Network,
    capture: Capture,
    device: torch.device,
    rotations: int = 1,
    side: int = 0,
    prior: str | None = None,
    passes: int = 1,
) -> Solution:
    """What a network tells of a capture, on `device` (where it is moved).

    Parameters
    ----------
    rotations : 1, or 4: average over quarter turns of the images; four times the work
    side : of a window in pixels, without its margins; 0: what suits the device and the memory
    prior : a classical method in place of the one that the network learned with; "": none
    passes : how often the network looks; from the second time on its own normals are the prior
    """
    if rotations not in (1, 4):
        raise InputError(f"{rotations} rotations came but 1 or 4 is possible; quarter turns keep the pixels.")
    if passes < 1:
        raise InputError(f"{passes} passes came but at least 1 is needed.")
    start = prior_named(net.config.prior if prior is None else prior)
    net = placed(net, device).eval()
    box = Box.of(capture, net.stride)
    side = -(-side // net.stride) * net.stride if side else plan.side(net, passes, rotations, device, box.mask.shape)
    with torch.inference_mode():
        look = first_look(net.scaling, capture, box, device, start)
        found: Tensor | None = None  # (d, h, w), on the processor
        # each pass reaches as far into what the pass before has found
        windows = box.windows(side, passes * net.reach)
        with progress("normals", len(windows) * passes * capture.images.shape[0]) as advance:
            for window in windows:
                part = looked(net, capture, box, look, window, device, rotations, passes, advance)
                found = torch.zeros(len(part), *box.mask.shape) if found is None else found
                found[:, *window.core] = part
        assert found is not None  # a mask has pixels
        found[:3] *= look.lit.cpu()
        values = box.on_mask(found)  # (p, d)
    return Solution(values[:, :3].clone(), values[:, 3].clone() if len(found) > 3 else None)


def looked(
    net: Network,
    capture: Capture,
    box: Box,
    look: FirstLook,
    window: Window,
    device: torch.device,
    rotations: int,
    passes: int,
    advance: Callable[[int], None],
) -> Float[Tensor, "d h w"]:
    """All passes over a window: normals of its core, and expected errors where the network tells them.

    `advance` is told how many images were looked at.
    """
    found = look.prior[:, *window.seen][None]  # (1, d, h, w), the last pass's, or the prior
    for following in reversed(range(passes)):
        before, window = window, window.narrowed((following + 1) * net.reach)
        start = found[..., *window.within(before)].to(device)
        found = one_pass(net, capture, box, look, window, start, rotations, advance)
    values = found[0, :, *window.inside]
    return torch.cat([values[:3], values[3 + net.memory :]])


def one_pass(
    net: Network,
    capture: Capture,
    box: Box,
    look: FirstLook,
    window: Window,
    found: Float[Tensor, "1 d h w"],
    rotations: int,
    advance: Callable[[int], None],
) -> Float[Tensor, "1 e h w"]:
    """One look at every image, from the normals, and the network's memory, of the last one; on the processor."""
    device, n = found.device, capture.images.shape[0]
    mask = box.mask[window.seen][None, None].to(device)  # (1, 1, h, w)
    L = box.lights(capture, window.seen).to(device)  # (n, 3), or (n, 3, h, w)
    moments = look.moments if look.moments.numel() == 1 else look.moments[..., *window.seen]
    turns = [Turn(net, r, found[:, : 3 + net.memory] * mask, L, mask) for r in range(rotations)]
    together = 1 if device.type == "cpu" else max(1, SEEN // (mask.numel() * rotations))
    for j, images in frames(capture, box, window.seen, device, together):
        images = scaled(net.scaling, images, mask, moments, n)
        for turn in turns:
            turn.add(images, L[j : j + images.shape[1]])
        advance(images.shape[1])
    total = torch.zeros(1)
    for turn in turns:
        total = total + turn.result(n)
    total[:, :3] = torch.nn.functional.normalize(total[:, :3], dim=1)
    total[:, 3:] /= len(turns)
    return total


class Turn:
    """A network that looks at a window in one of four quarter turns: images go in, what it tells comes out."""

    def __init__(
        self,
        net: Network,
        quarters: int,
        prior: Float[Tensor, "1 d h w"],
        L: Float[Tensor, "n 3 *hw"],
        mask: Bool[Tensor, "1 1 h w"],
    ) -> None:
        self.net, self.quarters, self.device = net, quarters, L.device
        prior = turned(torch.rot90(prior, quarters, (2, 3)), quarters, 1)
        with inner_precision(L.device):
            self.shared = net.begin(prior, self.lights(L))
        self.parts = list(parts(net, self.shared, torch.rot90(mask, quarters, (2, 3))))
        self.pooled: list[Any] = [None] * len(self.parts)

    def add(self, images: Float[Tensor, "1 k c h w"], L: Float[Tensor, "k 3 *hw"]) -> None:
        """Look at k scaled images under the lights `L`."""
        images, lights = torch.rot90(images, self.quarters, (3, 4)), self.lights(L)
        for i, (rows, shared) in enumerate(self.parts):
            at = lights if lights.ndim == 3 else lights[..., rows, :]
            with inner_precision(L.device):
                new = self.net.encode(images[..., rows, :], at, shared)
            self.pooled[i] = new if self.pooled[i] is None else self.pooled[i].merged(new)

    def lights(self, L: Float[Tensor, "k 3 *hw"]) -> Float[Tensor, "1 k 3 *ij"]:
        """Lights after the turn."""
        return turned(L[None] if L.ndim == 2 else torch.rot90(L[None], self.quarters, (3, 4)), self.quarters, 2)

    def result(self, n: int) -> Float[Tensor, "1 d h w"]:
        """What the network tells after all n images, turned back; what was pooled is then forgotten."""
        with inner_precision(self.device):
            found = [self.net.digest(self.pooled.pop(0), n, shared) for _, shared in self.parts]
            told = self.net.look(found[0] if len(found) == 1 else torch.cat(found, dim=1), n, self.shared).float()
        return torch.rot90(turned(told, -self.quarters, 1), -self.quarters, (2, 3)).cpu()


def parts(net: Network, shared: Any, mask: Bool[Tensor, "1 1 h w"]) -> Iterator[tuple[slice, Any]]:
    """Rows of a window to take at a time, with what all images share of them; all rows, or few on a processor.

    What is small is soon reused; the result is the same.
    """
    h, w = mask.shape[2:]
    if mask.device.type != "cpu" or not net.pointwise:
        yield slice(h), shared
        return
    step = max(1, PART // w)
    for y in range(0, h, step):
        yield slice(y, y + step), shared.rows(slice(y, y + step))


def turned(v: Tensor, quarters: int, axis: int) -> Tensor:
    """Vectors along `axis` turned about the view axis, counter-clockwise by quarter turns; from z on all stays."""
    x, y, *rest = v.unbind(axis)
    for _ in range(quarters % 4):
        x, y = -y, x
    return torch.stack([x, y, *rest], axis)
