"""Which part of a frame is computed, piece by piece, and what each piece has to see for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.masked import box_of
from photonormal.types import Capture

Span = tuple[slice, slice]  # rows and columns


@dataclass(frozen=True)
class Box:
    """The mask's box, its size rounded up to a network's stride; rows and columns count from its corner."""

    top: int
    left: int
    mask: Tensor  # (h, w) bool

    @staticmethod
    def of(capture: Capture, stride: int) -> Box:
        rows, columns = box_of(capture.mask)
        h, w = (-(-(s.stop - s.start) // stride) * stride for s in (rows, columns))
        mask = torch.zeros(h, w, dtype=torch.bool)
        mask[: rows.stop - rows.start, : columns.stop - columns.start] = torch.from_numpy(capture.mask[rows, columns])
        return Box(rows.start, columns.start, mask)

    def read(self, capture: Capture, j: int, seen: Span) -> Float[Tensor, "1 1 c h w"]:
        """A part of the box of picture `j`; zero where it reaches beyond the frame, and where samples are no numbers or
        below zero.

        They are that once an ambient picture was subtracted: no light, and noise.
        """
        rows, columns = seen
        part = capture.window(
            j,
            slice(self.top + rows.start, self.top + rows.stop),
            slice(self.left + columns.start, self.left + columns.stop),
        )
        found = torch.zeros(1, 1, part.shape[2], rows.stop - rows.start, columns.stop - columns.start)
        found[0, 0, :, : part.shape[0], : part.shape[1]] = torch.from_numpy(part).permute(2, 0, 1)
        return found.nan_to_num_(0, 0, 0).clamp_(min=0)

    def lights(self, capture: Capture, seen: Span) -> Float[Tensor, "n 3 *hw"]:
        """Light directions (n, 3), or (n, 3, h, w): those that each pixel of a part of the box sees."""
        L = torch.as_tensor(capture.known_lights(), dtype=torch.float32)
        if capture.lights_at is None:
            return L
        mask = self.mask[seen]
        L = L[..., None, None].repeat(1, 1, *mask.shape)
        L[:, :, mask] = torch.from_numpy(capture.lights_at[self.pixels(seen)]).permute(1, 2, 0)
        return L

    def pixels(self, seen: Span) -> np.ndarray:
        """Numbers of a part's pixels on the mask, counted over the whole mask row by row."""
        rows, columns = seen
        above = int(self.mask[: rows.start].sum())
        number = torch.cumsum(self.mask[rows].flatten(), 0).view(-1, self.mask.shape[1]) - 1
        return above + number[:, columns][self.mask[seen]].numpy()

    def count(self, seen: Span) -> int:
        """Pixels on the mask in a part of the box."""
        return int(self.mask[seen].sum())

    def on_mask(self, values: Float[Tensor, "d h w"]) -> Float[Tensor, "p d"]:
        """What is known of the mask's pixels, row by row."""
        return values[:, self.mask].T

    def rows(self, rows: slice | None) -> slice:
        """Some rows of the frame, or all, as rows of the box."""
        if rows is None:
            return slice(0, len(self.mask))
        first, last = (max(0, row - self.top) for row in (rows.start, rows.stop))
        return slice(first, last if self.mask[last:].any() else len(self.mask))

    def windows(self, tile: tuple[int, int], margin: int, rows: slice | None = None) -> list[Window]:
        """The parts of the box, or of some of its rows, each `tile` (h, w) at most, with `margin` pixels around; none
        without a mask pixel.

        What is less than two margins larger than a tile, with what it sees around it, is one part.
        """
        h, w = self.mask.shape
        rows = rows or slice(0, h)
        seen = min(rows.stop + margin, h) - max(rows.start - margin, 0)
        tile_h = rows.stop - rows.start if seen <= tile[0] + 2 * margin else tile[0]
        tile_w = w if w <= tile[1] + 2 * margin else tile[1]
        found = []
        for y in range(rows.start, rows.stop, tile_h):
            for x in range(0, w, tile_w):
                core = slice(y, min(y + tile_h, rows.stop)), slice(x, min(x + tile_w, w))
                if self.mask[core].any():
                    found.append(Window(core, (slice(0, h), slice(0, w))).narrowed(margin))
        return found


@dataclass(frozen=True)
class Window:
    """A part of a box: what is computed, and what is seen for it."""

    core: Span
    seen: Span

    def narrowed(self, margin: int) -> Window:
        """The same core, seen with no more than `margin` pixels around."""
        rows, columns = (
            slice(max(s.start, c.start - margin), min(s.stop, c.stop + margin))
            for c, s in zip(self.core, self.seen, strict=True)
        )
        return replace(self, seen=(rows, columns))

    def within(self, outer: Window) -> Span:
        """Where what this one sees lies in what the `outer` one sees."""
        return _offset(self.seen, outer.seen)

    @property
    def inside(self) -> Span:
        """Where the core lies in what is seen."""
        return _offset(self.core, self.seen)


def rows_seen(windows: Sequence[Window]) -> slice:
    """The rows that any of some windows sees."""
    return slice(min(w.seen[0].start for w in windows), max(w.seen[0].stop for w in windows))


def _offset(inner: Span, outer: Span) -> Span:
    rows, columns = (slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
    return rows, columns
