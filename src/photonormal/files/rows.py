"""Arrays on disk, of which some rows are read at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from math import prod
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from photonormal.files import memory
from photonormal.files.opening import array_header, npz_archive, read_array
from photonormal.files.scratch import Scratch, bytes_of

BLOCK = 2**24  # bytes copied at a time


class Rows:
    """An array in a scratch file, zeros at first: ``rows[a:b]`` is a copy of a part, ``rows[a:b] = values`` sets one.

    Slices may skip rows when they are read. Any other part is taken of all rows, which are read for it.
    InputError where the disk has no room for it.
    """

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype | type) -> None:
        self.shape, self.dtype = shape, np.dtype(dtype)
        self._row = prod(shape[1:]) * self.dtype.itemsize
        self._scratch = Scratch(shape[0] * self._row)

    def __enter__(self) -> Rows:
        return self

    def __exit__(self, *error: object) -> None:
        self._scratch.close()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self[:].astype(dtype or self.dtype, copy=False)

    def __getitem__(self, rows: Any) -> np.ndarray:
        if not isinstance(rows, slice):
            return self[:][rows]
        first, last, step = rows.indices(self.shape[0])
        values = np.empty((len(range(first, last, step)), *self.shape[1:]), self.dtype)
        at_once = len(values) if step == 1 else 1
        for k in range(0, len(values), at_once or 1):
            self._scratch.read((first + k * step) * self._row, values[k : k + at_once])
        return values

    def __setitem__(self, rows: slice, values: np.ndarray | float) -> None:
        first, last, _ = rows.indices(self.shape[0])
        shape = (last - first, *self.shape[1:])
        self._scratch.write(first * self._row, np.ascontiguousarray(np.broadcast_to(values, shape), self.dtype))


@contextmanager
def npz_rows(path: Path, advice: str, names: tuple[str, ...]) -> Iterator[dict[str, Rows]]:
    """The arrays of these names in an .npz file, as far as it holds them, copied into scratch files.

    Raises
    ------
    InputError
        If the file can't be read; `advice` says what to do.
    """
    with ExitStack() as kept:
        with npz_archive(path, advice) as archive:
            held = set(archive.namelist())
            found = {n: kept.enter_context(_copied(archive, f"{n}.npy")) for n in names if f"{n}.npy" in held}
        yield found


def _copied(archive: ZipFile, member: str) -> Rows:
    size = archive.getinfo(member).file_size
    with archive.open(member) as stream:
        shape, by_columns, dtype = array_header(stream)
        if dtype.kind not in "biuf" or not shape:
            raise ValueError(f"{member[:60]!r} holds {dtype} {shape}, not rows of numbers")
        if prod(shape) * dtype.itemsize > size:
            raise ValueError(f"it is truncated: {shape} {dtype} in {size} bytes")
    rows = Rows(shape, dtype)
    try:
        with archive.open(member) as stream:
            if by_columns:
                memory.check(size, f"what {member} holds")
                rows[:] = read_array(stream, size)
                return rows
            array_header(stream)
            block = max(1, BLOCK // max(1, rows._row))
            for y in range(0, shape[0], block):
                part = np.empty((min(block, shape[0] - y), *shape[1:]), dtype)
                if stream.readinto(bytes_of(part)) != part.nbytes:  # pyright: ignore[reportAttributeAccessIssue]
                    raise ValueError("it is truncated")
                rows[y : y + len(part)] = part
    except BaseException:
        rows.__exit__()
        raise
    return rows
