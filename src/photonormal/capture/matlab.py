"""One numeric array of a MATLAB file, version 5 to 7 ("MAT-File Format", MathWorks): nothing else in it is interpreted.

A file is a header and a row of elements: type, size, content. An array is an element of elements: flags, dimensions,
name, values; it may lie compressed in another element. Damaged files make general readers crash.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
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


def read_mat(path: Path, variable: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """The array called `variable`, float64, of the shape that MATLAB shows, which must be `shape` where that is given.

    Name and shape are looked at before anything else is unpacked.
    """
    data = read_bytes(path, "a .mat file")
    try:
        order = ORDERS.get(data[HEADER - 4 : HEADER])
        if order is None:
            raise ValueError("no MATLAB file of version 5 to 7")
        for kind, content in _elements(memoryview(data)[HEADER:], order):
            size = len(content)
            if kind == COMPRESSED:
                head = memoryview(zlib.decompressobj().decompress(content, HEAD))
                kind, size = struct.unpack_from(f"{order}II", head)
            else:
                head = content
            if kind != MATRIX or (found := _shape(head[8:] if head is not content else head, order, variable)) is None:
                continue
            if shape is not None and found != shape:
                raise InputError(f"{variable} in {path} is {found} but {shape} is needed; save it for these pictures.")
            nbytes = prod(found) * 8
            memory.check(nbytes, f"{variable} in {path}")
            if size > nbytes + HEAD:
                raise ValueError(f"{variable} has {size} bytes for {found} numbers")
            if head is not content:
                content = memoryview(zlib.decompressobj().decompress(content, 8 + size))[8:]
            return _array(content, order, variable)
    except InputError:
        raise
    except (ValueError, LookupError, StopIteration, struct.error, zlib.error, MemoryError, OverflowError) as error:
        raise InputError(
            f"{path} can't be read ({error or 'it is truncated'}); save {variable} as numbers in a version 7 .mat file."
        ) from None
    raise InputError(f"{path} has no array {variable} but it is needed; save it there.")


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


def _shape(matrix: memoryview, order: str, variable: str) -> tuple[int, ...] | None:
    """Shape of an array, or None where it has another name; its values need not be there."""
    parts = _elements(matrix, order)
    flags = struct.unpack_from(f"{order}I", next(parts)[1])[0]
    shape = tuple(np.frombuffer(next(parts)[1], f"{order}i4").tolist())
    if bytes(next(parts)[1]) != variable.encode():
        return None
    if flags & 0xFF not in NUMERIC or flags & COMPLEX:
        raise ValueError(f"{variable} holds no real numbers")
    if any(n < 0 for n in shape):
        raise ValueError(f"{variable} is {shape}")
    return shape


def _array(matrix: memoryview, order: str, variable: str) -> np.ndarray:
    """Values of the array."""
    shape = _shape(matrix, order, variable)
    *_, (kind, content) = islice(_elements(matrix, order), 4)
    return np.frombuffer(content, order + NUMBERS[kind]).astype(np.float64).reshape(shape, order="F")
