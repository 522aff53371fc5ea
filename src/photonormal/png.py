"""PNG: pictures with what is said about them, in chunks beside the samples."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from typing import BinaryIO

import numpy as np

START = b"\x89PNG\r\n\x1a\n"
HEADER_END = 33  # bytes of the start and of the first chunk, which shows the size
ROWS = 256  # made at a time
LONGEST = 2**16  # bytes of a chunk that is read as a remark
SRGB = {b"sRGB": b"\x00"}  # samples are sRGB-encoded


def encode_png(picture: np.ndarray, chunks: dict[bytes, bytes] | None = None) -> bytes:
    """PNG of (h, w) or (h, w, 3) RGB samples, 8 or 16-bit, as they are; `chunks` go before them."""
    import cv2

    bgr = picture[..., ::-1] if picture.ndim == 3 else picture
    data = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    if not chunks:
        return data
    parts = (_chunk(kind, content) for kind, content in chunks.items())
    return b"".join([data[:HEADER_END], *parts, data[HEADER_END:]])


def encode_mask(mask: np.ndarray) -> bytes:
    """PNG of a mask (h, w), white where it holds."""
    return encode_png(mask.astype(np.uint8) * np.uint8(255))


def by_rows(
    rows: Callable[[slice], np.ndarray],
    size: tuple[int, int],
    dtype: np.dtype | type,
    chunks: dict[bytes, bytes] | None = None,
) -> Callable[[BinaryIO], None]:
    """What writes a PNG of RGB samples into an open file, of which `rows` makes some rows at a time."""

    def write(file: BinaryIO) -> None:
        picture = PngRows(file, size, dtype, colour=True, chunks=chunks)
        for top in range(0, size[0], ROWS):
            picture.write(rows(slice(top, top + ROWS)))
        picture.close()

    return write


class PngRows:
    """A PNG as `encode_png` makes it, written into an open file some rows after the other; `close` ends it."""

    def __init__(
        self,
        file: BinaryIO,
        size: tuple[int, int],
        dtype: np.dtype | type,
        colour: bool,
        chunks: dict[bytes, bytes] | None = None,
    ) -> None:
        depth = np.dtype(dtype).itemsize
        self._file, self._kind, self._pixel = file, np.dtype(dtype).newbyteorder(">"), depth * (3 if colour else 1)
        self._pack = zlib.compressobj(1, strategy=zlib.Z_RLE)
        header = struct.pack(">IIBBBBB", size[1], size[0], 8 * depth, 2 if colour else 0, 0, 0, 0)
        file.write(START + _chunk(b"IHDR", header))
        for kind, content in (chunks or {}).items():
            file.write(_chunk(kind, content))

    def write(self, rows: np.ndarray) -> None:
        """Append rows (n, w) or (n, w, 3): each sample as its difference to that of the pixel before."""
        samples = rows.astype(self._kind).view(np.uint8).reshape(len(rows), -1)
        lines = np.ones((len(rows), samples.shape[1] + 1), np.uint8)  # 1: this filter
        first = 1 + self._pixel
        lines[:, 1:first] = samples[:, : self._pixel]
        np.subtract(samples[:, self._pixel :], samples[:, : -self._pixel], out=lines[:, first:])
        self._append(self._pack.compress(lines.data))

    def close(self) -> None:
        """Write what is left; the file stays open."""
        self._append(self._pack.flush())
        self._file.write(_chunk(b"IEND", b""))

    def _append(self, data: bytes) -> None:
        if data:
            self._file.write(_chunk(b"IDAT", data))


def text(key: str, value: str) -> dict[bytes, bytes]:
    """A remark, as `encode_png` takes it and `texts` reads it."""
    return {b"tEXt": key.encode("latin-1") + b"\0" + value.encode("latin-1")}


def remarks(file: BinaryIO, longest: int = LONGEST) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of the chunks before the samples, but longer ones; none where the open file is no PNG."""
    file.seek(0)
    if file.read(len(START)) != START:
        return
    while len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        if kind in (b"IDAT", b"IEND"):
            return
        if length > longest:
            file.seek(length + 4, 1)
        else:
            yield kind, file.read(length)
            file.seek(4, 1)


def texts(file: BinaryIO) -> dict[str, str]:
    """The remarks of an open PNG by their keys."""
    found = (content.split(b"\0", 1) for kind, content in remarks(file) if kind == b"tEXt" and b"\0" in content)
    return {key.decode("latin-1"): value.decode("latin-1") for key, value in found}


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
