"""Numeric arrays of a MATLAB file, version 5 to 7 ("MAT-File Format", MathWorks): nothing else in it is interpreted.

A file is a header and a row of elements: type, size, content. An array is an element of elements: flags, dimensions,
name, values; it may lie compressed in another element. Damaged files make general readers crash.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from math import prod
from pathlib import Path

import numpy as np

from photonormal.files import memory
from photonormal.files.opening import read_bytes
from photonormal.types import InputError

HEADER = 128  # bytes
ORDERS = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}  # its end: version and byte order
MATRIX, COMPRESSED = 14, 15  # types of elements
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
NUMERIC = range(6, 16)  # classes of arrays: double, single and integers
COMPLEX = 0x800
HEAD = 4096  # bytes that hold an array's flags, shape and name


@dataclass(frozen=True)
class Head:
    """What an array's element begins with."""

    name: str
    shape: tuple[int, ...]
    numeric: bool


def read_mat(path: Path, variable: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """The array called `variable`, float64, of the shape that MATLAB shows, which must be `shape` where that is given.

    Name and shape are looked at before anything else is unpacked.
    """
    with _refusals(path, f"save {variable} as numbers in a version 7 .mat file"):
        for head, size, order, unpacked in _arrays(path):
            if head.name != variable:
                continue
            if not head.numeric:
                raise ValueError(f"{variable} holds no real numbers")
            if shape is not None and head.shape != shape:
                raise InputError(
                    f"{variable} in {path} is {head.shape} but {shape} is needed; save it for these pictures."
                )
            nbytes = prod(head.shape) * 8
            memory.check(nbytes, f"{variable} in {path}")
            if size > nbytes + HEAD:
                raise ValueError(f"{variable} has {size} bytes for {head.shape} numbers")
            *_, (kind, content) = islice(_elements(unpacked(), order), 4)
            return np.frombuffer(content, order + NUMBERS[kind]).astype(np.float64).reshape(head.shape, order="F")
    raise InputError(f"{path} has no array {variable} but it is needed; save it there.")


def shapes_of(path: Path) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the numeric arrays."""
    with _refusals(path, "save it as a version 7 .mat file"):
        return {head.name: head.shape for head, *_ in _arrays(path) if head.numeric}


def _arrays(path: Path) -> Iterator[tuple[Head, int, str, Callable[[], memoryview]]]:
    """Head, size in bytes and byte order of each array, and what unpacks it."""
    data = read_bytes(path, "a .mat file")
    order = ORDERS.get(data[HEADER - 4 : HEADER])
    if order is None:
        raise ValueError("no MATLAB file of version 5 to 7")
    for kind, content in _elements(memoryview(data)[HEADER:], order):
        if kind == COMPRESSED:
            start = memoryview(zlib.decompressobj().decompress(content, HEAD))
            kind, size = struct.unpack_from(f"{order}II", start)
            head, unpacked = start[8:], partial(_inflated, content, size)
        else:
            head, size, unpacked = content, len(content), partial(memoryview, content)
        if kind == MATRIX:
            yield _head(head, order), size, order, unpacked


def _inflated(content: memoryview, size: int) -> memoryview:
    return memoryview(zlib.decompressobj().decompress(content, 8 + size))[8:]


def _head(matrix: memoryview, order: str) -> Head:
    """An array's head; its values need not be there."""
    flags, dimensions, name = (bytes(content) for _, content in islice(_elements(matrix, order), 3))
    flag = struct.unpack_from(f"{order}I", flags)[0]
    shape = tuple(np.frombuffer(dimensions, f"{order}i4").tolist())
    if any(n < 0 for n in shape):
        raise ValueError(f"an array is {shape}")
    return Head(name.decode("utf-8", "replace"), shape, flag & 0xFF in NUMERIC and not flag & COMPLEX)


@contextmanager
def _refusals(path: Path, advice: str) -> Iterator[None]:
    """Whatever a damaged file raises becomes an InputError."""
    try:
        yield
    except InputError:
        raise
    except (ValueError, LookupError, struct.error, zlib.error, MemoryError, OverflowError) as error:
        raise InputError(f"{path} can't be read ({error or 'it is truncated'}); {advice}.") from None


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of each element."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start, step = at + 8, 8 + -(-size // 8) * 8
        if kind >> 16:  # up to four bytes, packed into the head
            kind, size, start, step = kind & 0xFFFF, kind >> 16, at + 4, 8
        elif kind == COMPRESSED:  # the only one without padding
            step = 8 + size
        if start + size > len(data):
            raise ValueError("it is truncated")
        yield kind, data[start : start + size]
        at += step
