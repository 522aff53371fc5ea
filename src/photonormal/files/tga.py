"""Truevision TGA, plain and run-length encoded ("Truevision TGA File Format Specification", version 2.0, 1991)."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np

from photonormal.files.header import Header, damaged
from photonormal.files.opening import size_of

HEADER = struct.Struct("<BBBHHBHHHHBB")
PALETTE, COLOUR, GREY = 1, 2, 3  # kinds of picture; 8 more where runs are encoded
RUNS = 8
DEPTHS = {PALETTE: (8, 16), COLOUR: (15, 16, 24, 32), GREY: (8, 16)}  # bits of a pixel
FROM_RIGHT, FROM_TOP = 0x10, 0x20  # bits of the descriptor; its low four count the bits of alpha


def header(file: BinaryIO, path: Path) -> Header:
    """Size by the file's own header."""
    h, w = _fields(file, path)[-3:-1]
    return Header(h, w, h * w * 4)


def read(file: BinaryIO, path: Path) -> np.ndarray:
    """Samples (h, w) or (h, w, 3 or 4), uint8."""
    kind, runs, palette, start, bits, h, w, descriptor = _fields(file, path)
    first, entries, entry_bits = palette
    file.seek(start)
    data = file.read(size_of(file))
    table = -(-entry_bits // 8) * entries
    n, step = h * w, -(-bits // 8)
    pixels = data[table:]
    if runs:
        pixels = _unpacked(pixels, n * step, step, path)
    if len(data) < table or len(pixels) < n * step:
        raise damaged(path, f"is truncated ({size_of(file)} bytes)")
    raw = np.frombuffer(pixels, np.uint8, n * step).reshape(n, step)
    if kind == PALETTE:
        index = raw.view(f"<u{step}")[:, 0].astype(np.int64) - first
        if index.size and not 0 <= index.min() <= index.max() < entries:
            raise damaged(path, f"has colours beyond its {entries}")
        step, bits = -(-entry_bits // 8), entry_bits
        raw = np.frombuffer(data, np.uint8, table).reshape(entries, step)[index]
    picture = raw[:, :1] if kind == GREY else _colours(raw, bits, descriptor & 0x0F)
    picture = picture.reshape(h, w, -1)
    if not descriptor & FROM_TOP:
        picture = picture[::-1]
    return np.ascontiguousarray(picture[:, ::-1] if descriptor & FROM_RIGHT else picture)


def _fields(file: BinaryIO, path: Path) -> tuple[int, bool, tuple[int, int, int], int, int, int, int, int]:
    """Kind, whether runs are encoded, the palette's first index, entries and bits, where it begins, a pixel's bits,
    height, width, descriptor."""
    start = file.read(HEADER.size)
    if len(start) < HEADER.size:
        raise damaged(path, f"is truncated ({len(start)} bytes)")
    note, has_palette, kind, first, entries, entry_bits, _, _, w, h, bits, descriptor = HEADER.unpack(start)
    runs, kind = bool(kind & RUNS), kind & ~RUNS
    sound = bits in DEPTHS.get(kind, ()) and w and h and has_palette <= 1
    if kind == PALETTE:
        sound = sound and has_palette and entries and entry_bits in DEPTHS[COLOUR]
    if not sound:
        raise damaged(path, f"claims {w} x {h} pixels of kind {kind} and {bits} bits")
    palette = (first, entries, entry_bits) if has_palette else (0, 0, 0)
    return kind, runs, palette, HEADER.size + note, bits, h, w, descriptor


def _unpacked(data: bytes, size: int, step: int, path: Path) -> bytes:
    """`size` bytes from packets: a count, and one pixel to repeat, or as many pixels."""
    out, at = bytearray(), 0
    while len(out) < size:
        if at >= len(data):
            raise damaged(path, "is truncated")
        count, at = (data[at] & 0x7F) + 1, at + 1
        if data[at - 1] & 0x80:
            out += data[at : at + step] * count
            at += step
        else:
            out += data[at : at + step * count]
            at += step * count
    return bytes(out)


def _colours(raw: np.ndarray, bits: int, alpha_bits: int) -> np.ndarray:
    """RGB, or RGBA where the file has alpha, from blue, green, red, alpha, or from five bits each."""
    if bits in (15, 16):
        value = raw.view("<u2")[:, 0]
        five = np.stack([(value >> shift) & 31 for shift in (10, 5, 0)], axis=-1)
        return ((five * 255 + 15) // 31).astype(np.uint8)
    return raw[:, [2, 1, 0, 3]] if bits == 32 and alpha_bits == 8 else raw[:, 2::-1]
