"""NumPy arrays."""

from __future__ import annotations

from math import prod
from pathlib import Path
from typing import BinaryIO

import numpy as np

from photonormal.files.header import Header
from photonormal.files.opening import array_header, read_array, size_of


def header(file: BinaryIO, path: Path) -> Header:
    """Size of the array, which need not be a picture yet."""
    shape, _, dtype = array_header(file)
    h, w = (*shape, 0, 0)[:2]
    return Header(h, w, prod(shape) * dtype.itemsize)


def read(file: BinaryIO, path: Path) -> np.ndarray:
    """The array as stored."""
    return read_array(file, size_of(file))
