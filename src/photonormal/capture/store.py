"""Decoded samples of all pictures, each read once: in memory where they fit, else in a scratch file.

The file is laid out in blocks of rows and columns, each with that part of all pictures, so that a window of all of them
is read from few places. It has no name: nothing is left of it when the process ends, however it ends.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from threading import Lock

import numpy as np

from photonormal.files import memory
from photonormal.files.scratch import Scratch

log = logging.getLogger(__name__)

SIDE = 256  # of a block in a scratch file, pixels


class Store:
    """Samples (n, h, w, c) of a box of `n` pictures, each asked for once.

    Parameters
    ----------
    shape, dtype : of all of them
    read : gives the samples (h, w, c) of picture j; called once for each, by any thread
    """

    def __init__(self, shape: tuple[int, int, int, int], dtype: np.dtype, read: Callable[[int], np.ndarray]):
        self.shape, self.dtype, self.read = shape, np.dtype(dtype), read
        self._known = [False] * shape[0]
        self._locks = [Lock() for _ in range(shape[0])]
        self._opening = Lock()
        self._blocks: Held | OnDisk | None = None

    @property
    def in_memory(self) -> bool:
        """Whether all samples fit; at the side of what is done with them."""
        return memory.holds(math.prod(self.shape) * self.dtype.itemsize)

    def window(self, j: int, rows: slice, columns: slice) -> np.ndarray:
        """A part of picture `j`, which is read first if it has not been."""
        blocks = self.blocks
        if not self._known[j]:
            with self._locks[j]:
                if not self._known[j]:
                    blocks.put(j, self.read(j))
                    self._known[j] = True
        return blocks.window(j, rows, columns)

    @property
    def blocks(self) -> Held | OnDisk:
        """Where the samples lie."""
        with self._opening:
            if self._blocks is None:
                self._blocks = Held(self.shape, self.dtype) if self.in_memory else OnDisk(self.shape, self.dtype)
        return self._blocks


class Held:
    """Samples (n, h, w, c) in memory."""

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype) -> None:
        self.samples = np.empty(shape, dtype)
        memory.hold(self.samples)

    def put(self, j: int, samples: np.ndarray) -> None:
        """Those of picture `j`."""
        self.samples[j] = samples

    def window(self, j: int, rows: slice, columns: slice) -> np.ndarray:
        """A part of them."""
        return self.samples[j, rows, columns]


class OnDisk:
    """Samples (n, h, w, c) in a scratch file: blocks of SIDE rows and columns, each with that part of all pictures."""

    def __init__(self, shape: tuple[int, int, int, int], dtype: np.dtype) -> None:
        n, h, w, c = shape
        self.side, self.shape, self.dtype = SIDE, (n, -(-h // SIDE), -(-w // SIDE), c), dtype
        self.row, self.nbytes = SIDE * c * dtype.itemsize, scratch_nbytes(shape, dtype)  # a row of a block, all
        enough = memory.text_of(memory.to_hold(self.nbytes), "")
        self.scratch = Scratch(self.nbytes, f", or allow more memory, such as --memory {enough}")
        log.warning(
            "photonormal: %s of photographs are kept in a scratch file in %s",
            memory.text_of(self.nbytes),
            memory.scratch_folder(),
        )

    def put(self, j: int, samples: np.ndarray) -> None:
        """Those of picture `j`."""
        s, block = self.side, np.zeros((self.side, self.side, self.shape[3]), self.dtype)
        for y in range(self.shape[1]):
            for x in range(self.shape[2]):
                part = samples[y * s : (y + 1) * s, x * s : (x + 1) * s]
                block[: part.shape[0], : part.shape[1]] = part
                self.scratch.write(self.place(j, y, x), block[: part.shape[0]])

    def window(self, j: int, rows: slice, columns: slice) -> np.ndarray:
        """A part of them."""
        s, c, step = self.side, self.shape[3], rows.step or 1
        lines = range(rows.start, rows.stop, step)
        found = np.empty((len(lines), columns.stop - columns.start, c), self.dtype)
        for y in range(rows.start // s, -(-rows.stop // s)):
            here = slice(*(-(-max(0, row - rows.start) // step) for row in (y * s, min(rows.stop, (y + 1) * s))))
            if here.start == here.stop:
                continue
            top, bottom = lines[here.start], lines[here.stop - 1] + 1
            for x in range(columns.start // s, -(-columns.stop // s)):
                left, right = max(columns.start, x * s), min(columns.stop, (x + 1) * s)
                block = np.empty((bottom - top, s, c), self.dtype)
                self.scratch.read(self.place(j, y, x) + (top - y * s) * self.row, block)
                found[here, left - columns.start : right - columns.start] = block[::step, left - x * s : right - x * s]
        return found

    def place(self, j: int, y: int, x: int) -> int:
        """Where a block of picture `j` begins."""
        return ((y * self.shape[2] + x) * self.shape[0] + j) * self.side * self.row


def scratch_nbytes(shape: tuple[int, int, int, int], dtype: np.dtype) -> int:
    """Bytes of the scratch file that samples (n, h, w, c) would take."""
    n, h, w, c = shape
    return -(-h // SIDE) * -(-w // SIDE) * n * SIDE**2 * c * dtype.itemsize


class Framed:
    """A store whose box lies in a frame of `shape` (n, h, w, c), which is zero outside it."""

    def __init__(
        self,
        shape: tuple[int, int, int, int],
        box: tuple[slice, slice],
        dtype: np.dtype,
        read: Callable[[int], np.ndarray],
    ):
        n, _, _, c = shape
        self.frame, self.box = shape[1:3], box
        sides = (box[0].stop - box[0].start, box[1].stop - box[1].start)
        self.store = Store((n, *sides, c), dtype, read)

    def window(self, j: int, rows: slice, columns: slice) -> tuple[tuple[int, int], tuple[slice, slice], np.ndarray]:
        """Of a part of picture `j`: its size, where in it the box lies, and the samples there."""
        size, at, inner = [], [], []
        for span, side, box in zip((rows, columns), self.frame, self.box, strict=True):
            first, last, step = span.indices(side)
            size.append(len(range(first, last, step)))
            a, b = (min(max(0, -(-(edge - first) // step)), size[-1]) for edge in (box.start, box.stop))
            at.append(slice(a, b))
            start = first - box.start
            inner.append(slice(start + a * step, start + b * step, step) if a < b else slice(0, 0))
        return (size[0], size[1]), (at[0], at[1]), self.store.window(j, inner[0], inner[1])

    def image(self, j: int, rows: slice, columns: slice) -> np.ndarray:
        """A part of picture `j`."""
        size, at, samples = self.window(j, rows, columns)
        image = np.zeros((*size, self.store.shape[3]), self.store.dtype)
        image[at] = samples
        return image
