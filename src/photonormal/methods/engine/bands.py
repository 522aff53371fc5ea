"""What looks around a pixel, some rows after the other: what its steps give is kept while later rows need it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional as F

from photonormal.methods.engine import plan
from photonormal.methods.engine.pixels import PixelSamples, digested
from photonormal.methods.engine.task import Task
from photonormal.methods.engine.turns import mean, turned, turned_picture
from photonormal.methods.engine.windows import Span, Window
from photonormal.methods.inputs.workers import side_by_side
from photonormal.methods.learned.network import PixelNetwork, Step, lateness
from photonormal.resources import hand_back

Band = tuple[slice, Float[Tensor, "1 d h w"]]  # rows of the box, and what is known of them


class Look(NamedTuple):
    """One pass over a window of a box."""

    seen: Span
    told: Span  # what is asked for
    late: int  # rows by which what it begins with comes later than the pictures


def looked(net: PixelNetwork, task: Task, window: Window) -> Iterator[tuple[Span, Float[Tensor, "d h w"]]]:
    """All passes over a window, some rows at a time: what the network finds of its core."""
    rows, columns = window.seen
    firsts = range(rows.start // task.band * task.band, rows.stop, task.band)
    parts = [slice(max(y, rows.start), min(y + task.band, rows.stop)) for y in firsts]
    whole = len(parts) == 1 and window.core == tuple(slice(0, side) for side in task.box.mask.shape)
    every = PixelSamples.of(net, task, window.seen) if whole else None  # of every pass

    def samples(seen: Span) -> PixelSamples:
        return every or PixelSamples.of(net, task, seen)

    found: Iterator[Band] = ((rows, task.look.prior[rows, columns][None].to(task.device)) for rows in parts)
    for number in range(task.passes):
        seen, told = (window.narrowed((task.passes - number - k) * net.reach).seen for k in (0, 1))
        found = one_pass(net, task, Look(seen, told, number * net.reach), samples, found)
    for rows, values in found:
        yield (rows, window.core[1]), values[0].cpu()


def one_pass(
    net: PixelNetwork, task: Task, look: Look, samples: Callable[[Span], PixelSamples], found: Iterable[Band]
) -> Iterator[Band]:
    """What the network gives of a window, a band of rows at most at a time, from the last pass's normals and memory.

    Rows come in order, and go when those around them are there, too. `samples` gives those of some rows.
    """
    mask = task.box.mask.to(task.device)
    around: list[Around] = []
    end = look.told[0].start
    for rows, values in found:
        known = values[:, : 3 + net.memory] * mask[rows, look.seen[1]]
        seen = samples((rows, look.seen[1]))
        n = seen.I.shape[1]
        around = around or [Around(net, n, quarters, mask, look) for quarters in range(task.rotations)]
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

    Maps lie as the picture does; what they hold is turned. A step gives blocks of rows and columns that depend on the
    size of the box alone, not on the window or on how many rows come at a time: kernels round otherwise in other
    shapes, and in bf16 a next pass would make that a thousand times as large. Beyond the window blocks see zeros.
    """

    def __init__(self, net: PixelNetwork, n: int, quarters: int, mask: Bool[Tensor, "h w"], look: Look) -> None:
        self.steps, self.stride, self.quarters, self.look = net.steps(n), net.stride, quarters, look
        (self.height, self.width), self.device = mask.shape, mask.device
        self.block = plan.block((self.height, self.width), self.stride)
        self.late = {name: look.late + rows for name, rows in lateness(self.steps, self.stride).items()}
        self.count = (look.seen[0].start + look.late) // self.block  # of blocks that are done, or lie above
        self.kept: dict[str, KnownRows] = {}

    def add(self, maps: dict[str, Tensor]) -> Float[Tensor, "1 d q w"] | None:
        """Further rows of the maps that the steps begin with; the rows that can be told by now, if there are any."""
        some = any(rows.shape[2] < self.height for rows in maps.values())
        end = 0
        for name, rows in maps.items():
            end = self.keep(name, 1, rows).end
        maps.clear()
        count, left = divmod(end + self.look.late, self.block)
        told = []
        for number in range(self.count, count + (left > 0 and end == self.look.seen[0].stop)):
            for step in self.steps:
                if some:
                    hand_back()  # what each thread has freed: together that is as much as is held
                last = step is self.steps[-1]
                within, wanted = self.look.told if last else self.look.seen
                rows = slice(self.end(step, number), self.end(step, number + 1))
                inside = slice(max(rows.start, within.start), min(rows.stop, within.stop))
                if inside.start >= inside.stop:
                    continue
                made = self.made(step, rows, wanted)[:, :, _over(_moved(inside, -rows.start), step.stride)]
                if last:
                    told.append(made)
                else:
                    self.keep(step.gives, step.stride, made)
                del made
            self.count = number + 1
            self.forget()
        return torch.cat(told, dim=2) if told else None

    def end(self, step: Step, number: int) -> int:
        """The row at which so many blocks of a step end."""
        if number * self.block - self.look.late >= self.height:
            return self.height
        return max(0, number * self.block - self.late[step.gives])

    def keep(self, name: str, stride: int, rows: Float[Tensor, "1 d r w"]) -> KnownRows:
        """Further rows of a map, and those that are kept of it."""
        top, columns = self.look.seen[0].start, self.look.seen[1]
        kept = self.kept.setdefault(name, KnownRows(stride, top, columns))
        kept.add(rows)
        return kept

    def forget(self) -> None:
        """The rows that no step needs any more."""
        for name, rows in self.kept.items():
            rows.forget(min(self.end(s, self.count) - s.reach for s in self.steps if name in s.reads))

    def made(self, step: Step, rows: slice, wanted: slice) -> Float[Tensor, "1 d i j"]:
        """Some rows of what a step gives, in the columns wanted, a few of them by each core."""
        high, s = _around(rows, step.reach, self.height), step.stride

        def tile(columns: slice) -> Float[Tensor, "1 d i j"]:
            wide = _around(columns, step.reach, self.width)
            seen = (self.kept[name].between((high, wide)) for name in step.reads)
            told = step.of(*(turned_picture(part.float(), self.quarters) for part in seen))
            told = turned_picture(told, -self.quarters)
            return told[..., _over(_moved(rows, -high.start), s), _over(_moved(columns, -wide.start), s)].float()

        tiles = plan.tiles(self.width, (high.stop - high.start) // s**2, step.reach, self.stride)
        some = [t for t in tiles if t.start < wanted.stop and wanted.start < t.stop]
        parts = side_by_side(tile, some, self.device, plan.at_once()) if len(tiles) > 1 else [tile(tiles[0])]
        whole = torch.cat(parts, dim=3) if len(parts) > 1 else parts[0]
        return whole[..., _over(_moved(wanted, -some[0].start), s)]


class KnownRows:
    """Those rows of a map that are known and still needed, of `stride` rows of the picture each, in some columns."""

    def __init__(self, stride: int, top: int, columns: slice) -> None:
        self.stride, self.start = stride, top // stride  # number of the first one
        self.columns = _over(columns, stride)
        self.parts: list[Float[Tensor, "1 d r w"]] = []

    def add(self, rows: Float[Tensor, "1 d r w"]) -> None:
        """What follows below."""
        self.parts.append(rows)

    @property
    def end(self) -> int:
        """The row of the picture where they end."""
        return self.stride * (self.start + sum(part.shape[2] for part in self.parts))

    def between(self, seen: Span) -> Float[Tensor, "1 d r w"]:
        """A part of the picture, zero where nothing is known; columns are counted in those of the picture, too."""
        rows, columns = (_over(s, self.stride) for s in seen)
        known = slice(max(columns.start, self.columns.start), min(columns.stop, self.columns.stop))
        found, start = [], self.start
        for part in self.parts:
            end = start + part.shape[2]
            if start < rows.stop and rows.start < end:
                high = slice(max(rows.start, start) - start, min(rows.stop, end) - start)
                found.append(part[:, :, high, _moved(known, -self.columns.start)])
            start = end
        whole = torch.cat(found, dim=2) if len(found) > 1 else found[0]
        above = max(0, self.start - rows.start)
        beyond = (known.start - columns.start, columns.stop - known.stop, above, max(0, rows.stop - start))
        return F.pad(whole, beyond) if any(beyond) else whole

    def forget(self, before: int) -> None:
        """The parts that lie above a row of the picture."""
        while self.parts and self.stride * (self.start + self.parts[0].shape[2]) <= before:
            self.start += self.parts.pop(0).shape[2]


def _moved(s: slice, by: int) -> slice:
    return slice(s.start + by, s.stop + by)


def _over(s: slice, stride: int) -> slice:
    return slice(s.start // stride, s.stop // stride)


def _around(s: slice, reach: int, size: int) -> slice:
    return slice(max(0, s.start - reach), min(size, s.stop + reach))
