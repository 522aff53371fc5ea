"""What looks around a pixel, some rows after the other: what its steps give is kept while later rows need it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.engine import plan
from photonormal.methods.engine.pixels import Samples, digested
from photonormal.methods.engine.task import Task
from photonormal.methods.engine.turns import mean, turned
from photonormal.methods.engine.windows import Span, Window
from photonormal.methods.engine.workers import side_by_side
from photonormal.methods.learned.network import PixelNetwork, Step
from photonormal.resources import hand_back

Band = tuple[slice, Float[Tensor, "1 d h w"]]  # rows of a window, and what is known of them


def looked(net: PixelNetwork, task: Task, window: Window) -> Iterator[tuple[Span, Float[Tensor, "d h w"]]]:
    """All passes over a window, some rows at a time: what the network tells of its core."""
    (top, bottom), columns = (window.seen[0].start, window.seen[0].stop), window.seen[1]
    mask = task.box.mask[window.seen].to(task.device)
    parts = [slice(y, min(y + task.band, bottom)) for y in range(top, bottom, task.band)]

    def read(rows: slice) -> Samples:
        return Samples.of(net, task, (rows, columns))

    every = read(window.seen[0]) if len(parts) == 1 else None  # of every pass

    def samples(rows: slice) -> Samples:
        return every or read(_moved(rows, top))

    prior = task.look.prior[:, :, columns]
    found: Iterator[Band] = ((_moved(rows, -top), prior[:, rows][None].to(task.device)) for rows in parts)
    for _ in range(task.passes):
        found = one_pass(net, task, samples, mask, found)
    for rows, values in found:
        rows = _moved(rows, top)
        within = slice(max(rows.start, window.core[0].start), min(rows.stop, window.core[0].stop))
        if within.start < within.stop:
            part = values[0, :, _moved(within, -rows.start), _moved(window.core[1], -columns.start)]
            yield (within, window.core[1]), part.cpu()


def _moved(s: slice, by: int) -> slice:
    return slice(s.start + by, s.stop + by)


def one_pass(
    net: PixelNetwork,
    task: Task,
    samples: Callable[[slice], Samples],
    mask: Bool[Tensor, "h w"],
    found: Iterable[Band],
) -> Iterator[Band]:
    """What the network tells of a window, a band of rows at most at a time, from the last pass's normals and memory.

    Rows come in order, and go when those around them are there, too. `samples` gives those of some rows.
    """
    around: list[Around] = []
    end = 0
    for rows, values in found:
        known = values[:, : 3 + net.memory] * mask[rows]
        seen = samples(rows)
        n = seen.I.shape[1]
        around = around or [Around(net, n, quarters, mask) for quarters in range(task.rotations)]
        pixels = digested(net, task, seen, known[0])
        del seen
        told = []
        for turn in around:
            shared = net.begin(turned(known, turn.quarters, 1), None)
            part = turn.add(net.maps(pixels.pop(0), shared))
            told += [] if part is None else [turned(part, -turn.quarters, 1)]
        for part in mean(told).split(task.band, dim=2) if told else ():
            rows = slice(end, end + part.shape[2])
            end = rows.stop
            yield rows, part


class Around:
    """The steps of a network over the rows of a window, in one of four quarter turns.

    Maps lie as the picture does; what they hold is turned.
    """

    def __init__(self, net: PixelNetwork, n: int, quarters: int, mask: Bool[Tensor, "h w"]) -> None:
        self.steps, self.stride, self.quarters = net.steps(n), net.stride, quarters
        (self.height, self.width), self.device = mask.shape, mask.device
        self.kept: dict[str, Rows] = {}
        self.done = dict.fromkeys((step.gives for step in self.steps), 0)  # rows of the picture

    def add(self, maps: dict[str, Tensor]) -> Float[Tensor, "1 d q w"] | None:
        """Further rows of the maps that the steps begin with; the rows that can be told by now, if there are any."""
        some = any(rows.shape[2] < self.height for rows in maps.values())
        for name, rows in maps.items():
            self.kept.setdefault(name, Rows(1)).add(rows)
        maps.clear()
        for step in self.steps:
            if some:
                hand_back()  # what each thread has freed: together that is as much as is held
            known = min(self.kept[name].end for name in step.reads)
            ready = known if known == self.height else (known - step.reach) // self.stride * self.stride
            if ready <= self.done[step.gives]:
                return None
            made = self.made(step, slice(self.done[step.gives], ready))
            self.done[step.gives] = ready
            self.forget()
            self.kept.setdefault(step.gives, Rows(step.stride)).add(made)
        return self.kept.pop(self.steps[-1].gives).parts[0]

    def forget(self) -> None:
        """The rows that no step needs any more."""
        for name, rows in self.kept.items():
            rows.forget(min(self.done[s.gives] - s.reach for s in self.steps if name in s.reads))

    def made(self, step: Step, rows: slice) -> Float[Tensor, "1 d i j"]:
        """Some rows of what a step gives, a few columns by each core."""
        top, bottom = max(0, rows.start - step.reach), min(self.height, rows.stop + step.reach)
        s = step.stride

        def tile(columns: slice) -> Float[Tensor, "1 d i j"]:
            left, right = max(0, columns.start - step.reach), min(self.width, columns.stop + step.reach)
            seen = (self.kept[name].between((slice(top, bottom), slice(left, right))) for name in step.reads)
            told = step.of(*(torch.rot90(part.float(), self.quarters, (2, 3)) for part in seen))
            told = torch.rot90(told, -self.quarters, (2, 3))
            inside = told[..., (rows.start - top) // s : (rows.stop - top) // s, :]
            return inside[..., (columns.start - left) // s : (columns.stop - left) // s].float()

        tiles = plan.tiles(self.width, (bottom - top) // s**2, step.reach, self.stride)
        parts = side_by_side(tile, tiles, self.device) if len(tiles) > 1 else [tile(tiles[0])]
        return torch.cat(parts, dim=3) if len(parts) > 1 else parts[0]


class Rows:
    """Those rows of a map that are known and still needed, of `stride` rows of the picture each."""

    def __init__(self, stride: int) -> None:
        self.stride, self.start = stride, 0  # number of the first one
        self.parts: list[Float[Tensor, "1 d r w"]] = []

    def add(self, rows: Float[Tensor, "1 d r w"]) -> None:
        """What follows below."""
        self.parts.append(rows)

    @property
    def end(self) -> int:
        """The row of the picture where they end."""
        return self.stride * (self.start + sum(part.shape[2] for part in self.parts))

    def between(self, seen: Span) -> Float[Tensor, "1 d r w"]:
        """A part of them; columns are counted in those of the picture, too."""
        rows, columns = (slice(s.start // self.stride, s.stop // self.stride) for s in seen)
        found, start = [], self.start
        for part in self.parts:
            end = start + part.shape[2]
            if start < rows.stop and rows.start < end:
                found.append(part[:, :, max(rows.start, start) - start : min(rows.stop, end) - start, columns])
            start = end
        return torch.cat(found, dim=2) if len(found) > 1 else found[0]

    def forget(self, before: int) -> None:
        """The parts that lie above a row of the picture."""
        while self.parts and self.stride * (self.start + self.parts[0].shape[2]) <= before:
            self.start += self.parts.pop(0).shape[2]
