"""One numeric array of a MATLAB file, version 5 to 7 ("MAT-File Format", MathWorks): nothing else in it is interpreted.

A file is a header and a row of elements: type, size, content. An array is an element of elements: flags, dimensions,
name, values; it may lie compressed in another element. Damaged files make general readers crash.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from photonormal.types import InputError

HEADER = 128  # bytes
ORDERS = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}  # its end: version and byte order
MATRIX, COMPRESSED = 14, 15  # types of elements
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
NUMERIC = range(6, 16)  # classes of arrays: double, single and integers
COMPLEX = 0x800
LARGEST = 2**31  # bytes that an array may unpack to


def read_mat(path: Path, variable: str) -> np.ndarray:
    """The array called `variable`, float64, of the shape that MATLAB shows."""
    try:
        data = path.read_bytes()
        order = ORDERS.get(data[HEADER - 4 : HEADER])
        if order is None:
            raise ValueError("no MATLAB file of version 5 to 7")
        for kind, content in _elements(memoryview(data)[HEADER:], order):
            if kind == COMPRESSED:
                unpacked = zlib.decompressobj().decompress(content, LARGEST)
                kind, content = next(_elements(memoryview(unpacked), order))
            if kind == MATRIX and (array := _array(content, order, variable)) is not None:
                return array
    except OSError as error:
        raise InputError(f"{path} can't be read ({error.strerror}) but a .mat file is needed; check it.") from None
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


def _array(matrix: memoryview, order: str, variable: str) -> np.ndarray | None:
    """Values of an array, or None where it has another name."""
    parts = _elements(matrix, order)
    flags = struct.unpack_from(f"{order}I", next(parts)[1])[0]
    shape = np.frombuffer(next(parts)[1], f"{order}i4").tolist()
    if bytes(next(parts)[1]) != variable.encode():
        return None
    if flags & 0xFF not in NUMERIC or flags & COMPLEX:
        raise ValueError(f"{variable} holds no real numbers")
    kind, content = next(parts)
    values = np.frombuffer(content, order + NUMBERS[kind])
    return values.astype(np.float64).reshape(shape, order="F")
