"""Sound small files that unpack to far more memory than a capture needs."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

SIDE = 20_000  # pixels


@cache
def _zeros(nbytes: int) -> bytes:
    """`nbytes` zeros, deflated."""
    packer, part = zlib.compressobj(1), bytes(2**20)
    return b"".join([packer.compress(part[: min(len(part), nbytes - at)]) for at in range(0, nbytes, len(part))]) + (
        packer.flush()
    )


def png(file: Path) -> None:
    """A grey picture of 400 MB."""
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 0)), (b"IDAT", _zeros(SIDE * (SIDE + 1))))
    data = b"\x89PNG\r\n\x1a\n"
    for kind, held in (*chunks, (b"IEND", b"")):
        data += struct.pack(">I", len(held)) + kind + held + struct.pack(">I", zlib.crc32(kind + held))
    file.write_bytes(data)


def mat(file: Path) -> None:
    """True normals, 4,000 x 4,000 x 3 doubles: 384 MB."""
    shape = (4000, 4000, 3)
    size = 8 * int(np.prod(shape))
    head = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<II3iI", 5, 12, *shape, 0)
    head += struct.pack("<II", 1, 9) + b"Normal_gt".ljust(16, b"\0") + struct.pack("<II", 9, size)
    packer = zlib.compressobj(1)
    packed = packer.compress(struct.pack("<II", 14, len(head) + size) + head)
    packed += b"".join(packer.compress(bytes(2**20)) for _ in range(size // 2**20)) + packer.flush()
    start = b"MATLAB 5.0 MAT-file".ljust(124, b" ") + struct.pack("<H2s", 0x0100, b"IM")
    file.write_bytes(start + struct.pack("<II", 15, len(packed)) + packed)


def npz(file: Path) -> None:
    """Arrays of 300 MB each, packed."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name in ("normals", "mask", "K", "D"):
            buffer = io.BytesIO()
            shape = {"descr": "<f4", "fortran_order": False, "shape": (5000, 5000, 3)}
            np.lib.format.write_array_header_1_0(buffer, shape)
            with archive.open(f"{name}.npy", "w") as member:
                member.write(buffer.getvalue())
                for _ in range(300):
                    member.write(bytes(10**6))


def tiff(file: Path) -> None:
    """A grey picture of 400 MB in one strip."""
    packed = _zeros(SIDE * SIDE)
    tags = ((256, SIDE), (257, SIDE), (258, 8), (259, 8), (262, 1), (273, 8), (277, 1), (278, SIDE), (279, len(packed)))
    data = struct.pack("<2sHI", b"II", 42, 8 + len(packed)) + packed + struct.pack("<H", len(tags))
    data += b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags) + bytes(4)
    file.write_bytes(data)


BOMBS: dict[str, Callable[[Path], None]] = {".png": png, ".mat": mat, ".npz": npz, ".tif": tiff}
