"""TIFF, by tifffile, and by OpenCV where a compression needs it."""

from __future__ import annotations

import logging
import lzma
import struct
import zlib
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from photonormal.files import memory
from photonormal.files.header import Header, damaged
from photonormal.files.opening import size_of
from photonormal.files.plain import opencv
from photonormal.types import InputError

PAGES = 1000  # directories of a file, at most
UNPACKERS = {  # compressions that unpack what they are given to the end
    **dict.fromkeys(("DEFLATE", "ADOBE_DEFLATE"), zlib.decompressobj),
    "LZMA": lzma.LZMADecompressor,
}
DENSEST = {"LZMA": 10_000}  # bytes that one byte may unpack to; 1032 for the others

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # what it has to say arrives as an InputError


def pages(file: BinaryIO, path: Path) -> int:
    """How many pictures it holds, smaller copies not counted."""
    with _opened(file, path) as tiff:
        return len(_pages(tiff))


def header(file: BinaryIO, path: Path, page: int | None = None) -> Header:
    """Size of a page, or of the only one."""
    with _opened(file, path) as tiff:
        it = _page(tiff, path, page)
        # (a tile is decoded as a whole, however little of it lies in the picture)
        sizes = [prod(it.chunks) * it.dtype.itemsize, it.nbytes] if it.dtype else [it.nbytes]
        return Header(it.imagelength, it.imagewidth, max(sizes))


def read(file: BinaryIO, path: Path, page: int | None = None) -> np.ndarray:
    """Samples (h, w) or (h, w, c) of a page, or of the only one."""
    with _opened(file, path) as tiff:
        it = _page(tiff, path, page)
        size, parts = size_of(file), list(zip(it.dataoffsets, it.databytecounts, strict=False))
        if len(parts) != prod(it.chunked) or any(n == 0 or start + n > size for start, n in parts):
            raise damaged(path, f"is truncated or damaged ({size} bytes)")  # tifffile would put zeros there
        compression = _name(it.compression)
        _check_parts(file, parts, compression, prod(it.chunks) * it.dtype.itemsize, path)
        try:
            picture = it.asarray()
        except (ValueError, ImportError) as error:  # a compression that tifffile leaves to another package
            if isinstance(error, ValueError) and "imagecodecs" not in str(error):
                raise
            if compression not in ("LZW", "JPEG", "DEFLATE", "ADOBE_DEFLATE") or len(_pages(tiff)) > 1:
                raise InputError(
                    f"picture {path} can't be decoded ({error}); pip install imagecodecs or export it uncompressed."
                ) from None
            file.seek(0)
            return opencv(file.read(size), path)
    if _name(it.photometric) == "MINISWHITE" and picture.dtype.kind in "ub":
        picture = ~picture
    return np.moveaxis(picture, 0, -1) if it.axes == "SYX" else picture


def _opened(file: BinaryIO, path: Path) -> Any:
    import tifffile

    _check_directories(file, path)
    file.seek(0)
    return tifffile.TiffFile(file, name=path.name)


def _pages(tiff: Any) -> list[Any]:
    return [p for p in tiff.pages if not getattr(p, "is_reduced", False)]


def _page(tiff: Any, path: Path, number: int | None) -> Any:
    found = _pages(tiff)
    if number is None and len(found) != 1:
        raise InputError(f"picture {path} holds {len(found)} pages but one is needed; export each as its own file.")
    if number is not None and number >= len(found):
        raise InputError(f"picture {path} holds {len(found)} pages but page {number + 1} is needed; export it again.")
    page = found[number or 0]
    photometric = _name(page.photometric)
    # JPEG's YCBCR becomes RGB by decoding
    samples = ("MINISWHITE", "MINISBLACK", "RGB", *(["YCBCR"] if _name(page.compression) == "JPEG" else []))
    if page.axes not in ("YX", "YXS", "SYX") or photometric not in samples or page.dtype is None:
        raise InputError(
            f"picture {path} is {photometric} with axes {page.axes} but grey levels or RGB are needed; convert it."
        )
    return page


def _name(value: Any) -> str:
    return getattr(value, "name", str(value))


def _check_directories(file: BinaryIO, path: Path) -> None:
    """Raise where the directories don't come to an end, or lie outside the file."""
    size = size_of(file)
    file.seek(0)
    start = file.read(16)
    order = {b"II": "<", b"MM": ">"}.get(start[:2], "")
    version = struct.unpack(f"{order}H", start[2:4])[0] if order and len(start) == 16 else 0
    if version not in (42, 43):
        raise damaged(path, f"is no TIFF ({size} bytes)")
    offset, count, entry = ("Q", "Q", 20) if version == 43 else ("I", "H", 12)
    at = struct.unpack_from(order + offset, start, 8 if version == 43 else 4)[0]
    seen: set[int] = set()
    while at:
        if at in seen or len(seen) >= PAGES:
            raise damaged(path, "has directories that point to each other" if at in seen else "has too many pages")
        seen.add(at)
        try:
            file.seek(at)
            entries = struct.unpack(order + count, file.read(struct.calcsize(order + count)))[0]
            file.seek(at + struct.calcsize(order + count) + entries * entry)
            at = struct.unpack(order + offset, file.read(struct.calcsize(order + offset)))[0]
        except (struct.error, OSError, OverflowError, ValueError):
            raise damaged(path, f"is truncated or damaged ({size} bytes)") from None


def _check_parts(file: BinaryIO, parts: list[Any], compression: str, nbytes: int, path: Path) -> None:
    """Raise where a strip or tile of `nbytes` samples unpacks to more than it should hold and memory allows."""
    unpacker = UNPACKERS.get(compression)
    if unpacker is None:
        return
    for start, n in parts:
        if n * DENSEST.get(compression, 1032) * memory.SHARE <= memory.allowed():
            continue
        file.seek(start)
        if len(unpacker().decompress(file.read(n), nbytes + 1)) > nbytes:
            raise damaged(path, "holds more samples than it should")
