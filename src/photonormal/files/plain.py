"""PNG, JPEG and BMP, recognised by content, since names lie; checked first, since OpenCV fills in what is missing."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import BinaryIO

import numpy as np

from photonormal.files.header import Header, damaged
from photonormal.files.opening import size_of

PNG_START = b"\x89PNG\r\n\x1a\n"
PNG_CHANNELS = {0: 1, 2: 3, 3: 4, 4: 2, 6: 4}  # colour type -> channels; a palette may hold alpha
JPEG_START, JPEG_SCAN, JPEG_END = b"\xff\xd8\xff", b"\xff\xda", b"\xff\xd9"
JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
MOST_SCANS = 200  # of a JPEG; each goes over the whole picture, and progressive ones have about ten


def header(file: BinaryIO, path: Path) -> Header:
    """Size by the file's own header."""
    start = file.read(64)
    if start.startswith(PNG_START):
        return _png_header(start, path)
    if start.startswith(JPEG_START):
        return _jpeg_header(file, path)
    if start.startswith(b"BM"):
        return _bmp_header(start, size_of(file), path)
    raise damaged(path, f"is no PNG, JPEG or BMP ({size_of(file)} bytes)")


def read(file: BinaryIO, path: Path) -> np.ndarray:
    """Samples (h, w) or (h, w, 3 or 4)."""
    data = file.read(size_of(file))
    if data.startswith(PNG_START):
        data = _whole_png(data, path)
    elif data.startswith(JPEG_START):
        _check_jpeg(data, path)
    return opencv(data, path)


def opencv(data: bytes, path: Path) -> np.ndarray:
    """The samples as OpenCV decodes them, RGB."""
    import cv2

    # OpenCV's own reader can't open every file name on every system, its decoder can
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise damaged(path, f"can't be decoded ({len(data)} bytes)")
    if picture.ndim == 3 and picture.shape[2] >= 3:
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB if picture.shape[2] == 3 else cv2.COLOR_BGRA2RGBA)
    return picture


def _png_header(start: bytes, path: Path) -> Header:
    if len(start) < 33 or start[12:16] != b"IHDR":
        raise damaged(path, "is truncated, or no PNG,")
    w, h, bits, colour = struct.unpack_from(">IIBB", start, 16)
    if not (w and h and colour in PNG_CHANNELS and bits in (1, 2, 4, 8, 16)):
        raise damaged(path, f"claims {w} x {h} pixels of colour type {colour} and {bits} bits")
    return Header(h, w, h * w * PNG_CHANNELS[colour] * (2 if bits == 16 else 1))


def _whole_png(data: bytes, path: Path) -> bytes:
    """The chunks of a PNG that hold samples, their checksums right: colour profiles and remarks don't reach libpng."""
    at, view = len(PNG_START), memoryview(data)
    kept = [view[:at]]
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            break
        critical = kind[0] < ord("a")
        if critical and zlib.crc32(view[at + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            raise damaged(path, f"is damaged (checksum of the chunk at byte {at})")
        if critical or kind == b"tRNS":
            kept.append(view[at:end])
        if kind == b"IEND":
            return b"".join(kept)
        at = end
    raise damaged(path, f"is truncated ({len(data)} bytes)")


def _jpeg_header(file: BinaryIO, path: Path) -> Header:
    """Size in the frame's segment; thumbnails lie in segments before it and have their own."""
    at = 2
    while True:
        file.seek(at)
        segment = file.read(10)
        if len(segment) < 10 or segment[0] != 0xFF or segment[1] == JPEG_SCAN[1]:
            raise damaged(path, f"is truncated ({size_of(file)} bytes)")
        if segment[1] in JPEG_FRAMES:
            h, w, channels = struct.unpack_from(">HHB", segment, 5)
            return Header(h, w, h * w * channels)
        at += 1 if segment[1] == 0xFF else 2 + int.from_bytes(segment[2:4], "big")


def _check_jpeg(data: bytes, path: Path) -> None:
    """Raise unless the end mark follows the first scan, after no more scans than a picture has."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        if data[at + 1] == JPEG_SCAN[1]:
            end = data.find(JPEG_END, at)
            scans = data.count(JPEG_SCAN, at, end if end > 0 else len(data))
            if scans > MOST_SCANS:
                raise damaged(path, f"has {scans} scans of its pixels")
            if end > 0:
                return
            break
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise damaged(path, f"is truncated ({len(data)} bytes)")


def _bmp_header(start: bytes, size: int, path: Path) -> Header:
    if len(start) < 30 or int.from_bytes(start[2:6], "little") > size:
        raise damaged(path, f"is truncated ({size} bytes)")
    old = int.from_bytes(start[14:18], "little") == 12  # OS/2's header
    w, h, _, bits = struct.unpack_from("<HHHH" if old else "<iiHH", start, 18)
    if w <= 0 or h == 0:
        raise damaged(path, f"claims {w} x {h} pixels")
    return Header(abs(h), w, abs(h) * w * (4 if bits == 32 else 3))
