"""Measuring with a network: images streamed one or a few at a time, in windows where the object is large.

The mask's box alone is computed; windows overlap by the network's reach, so they agree with the whole to rounding.
Memory is bounded in the number of pixels. A network that sees each by itself is shown some rows at a time (bands).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.methods.contract import Solution, Streaming
from photonormal.methods.engine import bands, plan
from photonormal.methods.engine.frames import frames
from photonormal.methods.engine.maps import Maps
from photonormal.methods.engine.prior import first_look, prior_named
from photonormal.methods.engine.task import Task
from photonormal.methods.engine.turns import mean, turned, turned_map
from photonormal.methods.engine.windows import Box, Span, Window, rows_seen
from photonormal.methods.inputs.scaling import scaled
from photonormal.methods.learned.network import Network, PixelNetwork, placed
from photonormal.methods.learned.processor import inner_precision
from photonormal.methods.uncalibrated.guess import guess
from photonormal.methods.uncalibrated.limits import check_findable
from photonormal.progress import progress
from photonormal.types import Capture, InputError

ROWS = 64  # whose normals are taken from maps at a time
SEEN = 2**21  # pixels, of all images together, that other devices than a processor encode at a time


def streamed(method: Streaming, capture: Capture, device: torch.device, rows: slice | None = None) -> Solution:
    """What a method's networks give of a capture, or of some rows of it."""
    first = None
    if (net := method.lights_network()) is not None:
        check_findable(capture)
        first = guess(net, capture, device)
        capture = first.shown_by(capture)
    net, prior = method.network(), method.prior or None
    found = measured(net, capture, device, method.rotations, prior=prior, passes=method.passes, rows=rows)
    return found if first is None else replace(found, lights=first.lights, intensities=first.intensities)


def measured(
    net: Network,
    capture: Capture,
    device: torch.device,
    rotations: int = 1,
    side: int = 0,
    prior: str | None = None,
    passes: int = 1,
    rows: slice | None = None,
) -> Solution:
    """What a network gives of a capture, on `device` (where it is moved).

    Parameters
    ----------
    rotations : 1, or 4: average over quarter turns of the images; four times the work
    side : of a window in pixels, without its margins, and of a band of rows; 0: what suits the device and the memory
    prior : a classical method in place of the one that the network learned with; "": none
    passes : how often the network looks; from the second time on its own normals are the prior
    rows : of the frame, which alone are asked for; None: all
    """
    if rotations not in (1, 4):
        raise InputError(f"{rotations} rotations came but 1 or 4 is possible; quarter turns keep the pixels.")
    if passes < 1:
        raise InputError(f"{passes} passes came but at least 1 is needed.")
    start = prior_named(net.config.prior if prior is None else prior)
    net = placed(net, device).eval()
    box = Box.of(capture, net.stride)
    with torch.inference_mode():
        # each pass reaches as far into what the pass before has found
        asked, margin = box.rows(rows), passes * net.reach
        near, n = capture.lights_at is not None, capture.images.shape[0]
        tile, band = plan.tile(net, passes, rotations, device, box.mask.shape, n, side, near)
        windows = box.windows(tile, margin, asked)
        look = first_look(net.scaling, capture, box, device, start, rows_seen(windows))
        found, tells = Maps(4, box.mask.shape, torch.device("cpu")), False
        look_at = partial(bands.looked, net) if isinstance(net, PixelNetwork) else partial(looked, net)
        with progress("normals", samples_seen(net, capture, box, windows, passes)) as advance:
            task = Task(capture, box, look, device, rotations, passes, band, advance)
            for window in windows:
                for core, values in look_at(task, window):
                    tells = len(values) > 3 + net.memory
                    found[core] = torch.cat([values[:3] * look.lit[core].cpu(), values[-1:]])
        normals, told_deg = at_mask_pixels(found, box, asked)
    return Solution(normals, told_deg if tells else None)


def at_mask_pixels(found: Maps, box: Box, asked: slice) -> tuple[Float[Tensor, "p 3"], Float[Tensor, " p"]]:
    """Normals and what follows them at the mask's pixels of some rows."""
    normals, last, first = torch.empty(p := box.count((asked, slice(None))), 3), torch.empty(p), 0
    for y in range(asked.start, asked.stop, ROWS):
        rows = slice(y, min(y + ROWS, asked.stop))
        values = found[rows, slice(None)][:, box.mask[rows]]  # (4, q)
        own = slice(first, first := first + values.shape[1])
        normals[own], last[own] = values[:3].T, values[3]
    return normals, last


def samples_seen(net: Network, capture: Capture, box: Box, windows: list[Window], passes: int) -> int:
    """Samples that are looked at in all passes over all windows."""
    each = (window.narrowed(p * net.reach) for window in windows for p in range(1, passes + 1))
    return sum(box.count(window.seen) for window in each) * capture.images.shape[0]


def looked(net: Network, task: Task, window: Window) -> Iterator[tuple[Span, Float[Tensor, "d h w"]]]:
    """All passes over a window: what the network finds of its core."""
    core, found = window.core, task.look.prior[window.seen][None]  # (1, d, h, w), the last pass's, or the prior
    for following in reversed(range(task.passes)):
        before, window = window, window.narrowed((following + 1) * net.reach)
        start = found[..., *window.within(before)][:, : 3 + net.memory].to(task.device)
        found = mean(one_pass(net, task, window, start)).cpu()
    yield core, found[0, :, *window.inside]


def one_pass(
    net: Network, task: Task, window: Window, found: Float[Tensor, "1 d h w"]
) -> Iterator[Float[Tensor, "1 e h w"]]:
    """One look at every image: what the network gives in each turn, from the last pass's normals and memory."""
    capture, box, look, device = task.capture, task.box, task.look, task.device
    n = capture.images.shape[0]
    mask = box.mask[window.seen][None, None].to(device)  # (1, 1, h, w)
    L = box.lights(capture, window.seen).to(device)  # (n, 3), or (n, 3, h, w)
    moments = look.moments if look.moments.numel() == 1 else look.moments[..., *window.seen]
    turns = [Turn(net, r, found * mask, L) for r in range(task.rotations)]
    together = 1 if device.type == "cpu" else max(1, SEEN // (mask.numel() * task.rotations))
    for j, images in frames(capture, box, window.seen, device, together):
        images = scaled(net.scaling, images, mask, moments, n)
        for turn in turns:
            turn.add(images, L[j : j + images.shape[1]])
        task.advance(images.shape[1] * box.count(window.seen))
    for turn in turns:
        yield turn.result(n)


class Turn:
    """A network that looks at a window in one of four quarter turns: images go in, what it finds comes out."""

    def __init__(
        self, net: Network, quarters: int, prior: Float[Tensor, "1 d h w"], L: Float[Tensor, "n 3 *hw"]
    ) -> None:
        self.net, self.quarters, self.device = net, quarters, L.device
        with inner_precision(L.device):
            self.shared = net.begin(turned_map(prior, quarters), self.lights(L))
        self.pooled: Any = None

    def add(self, images: Float[Tensor, "1 k c h w"], L: Float[Tensor, "k 3 *hw"]) -> None:
        """Look at k scaled images under the lights `L`."""
        with inner_precision(L.device):
            new = self.net.encode(torch.rot90(images, self.quarters, (3, 4)), self.lights(L), self.shared)
        self.pooled = new if self.pooled is None else self.pooled.merged(new)

    def lights(self, L: Float[Tensor, "k 3 *hw"]) -> Float[Tensor, "1 k 3 *ij"]:
        """Lights after the turn."""
        return turned(L, self.quarters, 1)[None] if L.ndim == 2 else turned_map(L, self.quarters)[None]

    def result(self, n: int) -> Float[Tensor, "1 d h w"]:
        """What the network gives after all n images, turned back; what was pooled is then forgotten."""
        pooled, self.pooled = self.pooled, None
        with inner_precision(self.device):
            told = self.net.decode(pooled, n, self.shared)
        return turned_map(told.float(), -self.quarters)
