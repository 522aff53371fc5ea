"""Bytes on disk that threads read and write at any place; nothing is left of them when the process ends, however it
ends."""

from __future__ import annotations

import os
from threading import Lock
from weakref import finalize

import numpy as np

from photonormal.files import memory


class Scratch:
    """So many bytes, zeros at first, in a file without a name, which is gone with this. InputError where the disk has
    no room for it; `otherwise` is what else may be done.

    It is not mapped: pages that are would count as the process's memory.
    """

    def __init__(self, nbytes: int, otherwise: str = "") -> None:
        self._file = memory.scratch_file(nbytes, otherwise)
        self._alone = Lock()
        self.close = finalize(self, self._file.close)

    def read(self, place: int, values: np.ndarray) -> None:
        """Fill an array, whose values lie one after the other, with what lies at a place."""
        part = bytes_of(values)
        while len(part):
            part = part[self._some(place + values.nbytes - len(part), part) :]

    def write(self, place: int, values: np.ndarray) -> None:
        """Put such an array there."""
        with self._alone:
            self._file.seek(place)
            self._file.write(bytes_of(values))

    def _some(self, place: int, part: memoryview) -> int:
        if hasattr(os, "preadv"):
            return os.preadv(self._file.fileno(), [part], place)
        with self._alone:
            self._file.seek(place)
            return self._file.readinto(part)  # pyright: ignore[reportAttributeAccessIssue]


def bytes_of(values: np.ndarray) -> memoryview:
    """Those of an array, whose values lie one after the other."""
    return values.reshape(-1).view(np.uint8).data
