"""Decoded samples of all pictures, each read once: in memory where they fit, else in a scratch file.

The file is laid out in blocks of rows and columns, each with that part of all pictures, so that a window of all of them
is read from few places. It has no name: nothing is left of it when the process ends, however it ends.
"""

from __future__ import annotations

import logging
import mmap
from collections.abc import Callable
from threading import Lock

import numpy as np

from photonormal.files import memory

log = logging.getLogger(__name__)

SIDE = 256  # of a block in a scratch file, pixels
SHARE = 3  # pictures may take this part of the memory; the rest is for what is done with them (`methods.engine.plan`)


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
        self._blocks: np.ndarray | None = None  # (rows, columns, n, side, side, c)

    @property
    def in_memory(self) -> bool:
        """Whether all samples fit; at the side of what is done with them."""
        return self._nbytes(*self.shape[1:3]) * SHARE <= memory.allowed()

    def window(self, j: int, rows: slice, columns: slice) -> np.ndarray:
        """A part of picture `j`, which is read first if it has not been."""
        blocks = self.blocks
        if not self._known[j]:
            with self._locks[j]:
                if not self._known[j]:
                    self._put(j, self.read(j))
                    self._known[j] = True
        a, b = blocks.shape[3:5]
        found = np.empty((rows.stop - rows.start, columns.stop - columns.start, self.shape[3]), self.dtype)
        for y in range(rows.start // a, -(-rows.stop // a)):
            for x in range(columns.start // b, -(-columns.stop // b)):
                top, left = max(rows.start, y * a), max(columns.start, x * b)
                bottom, right = min(rows.stop, (y + 1) * a), min(columns.stop, (x + 1) * b)
                part = blocks[y, x, j, top - y * a : bottom - y * a, left - x * b : right - x * b]
                if part.shape == found.shape and not isinstance(blocks, np.memmap):
                    return part
                found[top - rows.start : bottom - rows.start, left - columns.start : right - columns.start] = part
                self._unmap(y, x, j)
        return found

    def _put(self, j: int, samples: np.ndarray) -> None:
        blocks = self.blocks
        a, b = blocks.shape[3:5]
        for y in range(blocks.shape[0]):
            for x in range(blocks.shape[1]):
                part = samples[y * a : (y + 1) * a, x * b : (x + 1) * b]
                blocks[y, x, j, : part.shape[0], : part.shape[1]] = part
                self._unmap(y, x, j)

    def _unmap(self, y: int, x: int, j: int) -> None:
        """Of a scratch file, let go of the memory that shows a block: it would count as this process's."""
        blocks, drop = self.blocks, getattr(mmap, "MADV_DONTNEED", None)
        size = blocks[0, 0, 0].nbytes
        if isinstance(blocks, np.memmap) and drop is not None and size % mmap.PAGESIZE == 0:
            place = int(np.ravel_multi_index((y, x, j), blocks.shape[:3]))
            blocks._mmap.madvise(drop, place * size, size)  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def blocks(self) -> np.ndarray:
        """Where the samples lie: one block as large as the box in memory, or many of them on disk."""
        with self._opening:
            if self._blocks is None:
                h, w = self.shape[1:3]
                self._blocks = np.empty(self._laid_out(h, w), self.dtype) if self.in_memory else self._scratch()
        return self._blocks

    def _scratch(self) -> np.ndarray:
        nbytes = self._nbytes(SIDE, SIDE)
        enough = memory.text_of(SHARE * nbytes, "")
        with memory.scratch_file(nbytes, f", or allow more memory, such as --memory {enough}") as file:
            log.warning(
                "%s of photographs are kept in a scratch file in %s", memory.text_of(nbytes), memory.scratch_folder()
            )
            return np.memmap(file, self.dtype, "r+", shape=self._laid_out(SIDE, SIDE))

    def _laid_out(self, a: int, b: int) -> tuple[int, ...]:
        n, h, w, c = self.shape
        return -(-h // a), -(-w // b), n, a, b, c

    def _nbytes(self, a: int, b: int) -> int:
        return int(np.prod(self._laid_out(a, b), dtype=np.int64)) * self.dtype.itemsize


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
            first, last, _ = span.indices(side)
            a, b = max(first, box.start), min(last, box.stop)
            b = max(a, b)
            size.append(last - first)
            at.append(slice(a - first, b - first))
            inner.append(slice(a - box.start, b - box.start))
        return (size[0], size[1]), (at[0], at[1]), self.store.window(j, inner[0], inner[1])

    def image(self, j: int, rows: slice, columns: slice) -> np.ndarray:
        """A part of picture `j`."""
        size, at, samples = self.window(j, rows, columns)
        image = np.zeros((*size, self.store.shape[3]), self.store.dtype)
        image[at] = samples
        return image
