"""Exif data and colour profiles, made by code and put into picture files."""

import struct
import zlib
from pathlib import Path

import numpy as np

from tests.capture.files import write_picture

SRGB, ADOBE = 1, 2  # Exif's colour spaces


def exif(colour_space: int = 0, orientation: int = 0, order: str = "<", rules: bytes = b"") -> bytes:
    """Exif's block with an orientation and a colour space, where they are not 0, and rules of interoperability."""
    last = _directory([(1, 2, rules)], order, 0) if rules else b""
    own: list = [(0xA001, 3, colour_space)] if colour_space else []
    own += [(0xA005, 4, 0)] if rules else []
    first: list = [(0x0112, 3, orientation)] if orientation else []
    at = 8 + 2 + 12 * (len(first) + 1) + 4
    if rules:
        own[-1] = (0xA005, 4, at + 2 + 12 * len(own) + 4)
    start = struct.pack(order + "2sHI", b"II" if order == "<" else b"MM", 42, 8)
    return start + _directory([*first, (0x8769, 4, at)], order, 0) + _directory(own, order, 0) + last


def _directory(entries: list, order: str, following: int) -> bytes:
    data = struct.pack(order + "H", len(entries))
    for tag, kind, value in entries:
        form = {2: "4s", 3: "Hxx", 4: "I"}[kind]
        data += struct.pack(order + "HHI" + form, tag, kind, len(value) if kind == 2 else 1, value)
    return data + struct.pack(order + "I", following)


def curv(*values: int) -> bytes:
    """A tone curve: an exponent in 256ths, or a table of 16-bit values; none: straight."""
    return struct.pack(f">4s4xI{len(values)}H", b"curv", len(values), *values)


def para(kind: int, *parameters: float) -> bytes:
    """A parametric tone curve."""
    return struct.pack(f">4s4xHxx{len(parameters)}i", b"para", kind, *(round(65536 * p) for p in parameters))


def profile(*curves: bytes, name: str = "a profile", primaries: np.ndarray | None = None) -> bytes:
    """A profile of grey levels with one tone curve, or of RGB with three; of a printer with none.

    `primaries` are columns of XYZ, one for red, green and blue each.
    """
    space = {0: b"RGB ", 1: b"GRAY", 3: b"RGB "}[len(curves)]
    names = {0: (), 1: (b"kTRC",), 3: (b"rTRC", b"gTRC", b"bTRC")}[len(curves)]
    text = name.encode() + b"\0"
    tags = {b"desc": struct.pack(">4s4xI", b"desc", len(text)) + text, **dict(zip(names, curves, strict=True))}
    if primaries is not None:
        tags |= {
            key: struct.pack(">4s4x3i", b"XYZ ", *(round(65536 * float(v)) for v in column))
            for key, column in zip((b"rXYZ", b"gXYZ", b"bXYZ"), primaries.T, strict=True)
        }
    table, data, at = b"", b"", 128 + 4 + 12 * len(tags)
    for key, content in tags.items():
        content += bytes(-len(content) % 4)
        table += struct.pack(">4sII", key, at + len(data), len(content))
        data += content
    head = struct.pack(">I8x4s4s4s12x4s", at + len(data), b"mntr", space, b"XYZ ", b"acsp")
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + data


def write_with(path: Path, picture: np.ndarray, exif: bytes = b"", profile: bytes = b"", kind: str = "") -> Path:
    """A picture of the suffix `kind`, or the path's own, whatever the path's, with what is embedded."""
    kind = kind or path.suffix
    if kind == ".tif":
        extra = [(34675, 7, len(profile), profile, True)] if profile else []
        return write_picture(path, picture, extratags=extra)
    plain = write_picture(path.with_name(f"plain{kind}"), picture)
    data = plain.read_bytes()
    plain.unlink()
    if kind == ".png":
        chunks = [(b"eXIf", exif)] if exif else []
        chunks += [(b"iCCP", b"name\0\0" + zlib.compress(profile))] if profile else []
        whole = b"".join(struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks)
        path.write_bytes(data[:33] + whole + data[33:])
        return path
    parts = [profile[k : k + 1000] for k in range(0, len(profile), 1000)]  # as long ones are
    segments = [(0xE1, b"Exif\0\0" + exif)] if exif else []
    segments += [(0xE2, b"ICC_PROFILE\0" + bytes([k + 1, len(parts)]) + part) for k, part in enumerate(parts)]
    whole = b"".join(bytes([0xFF, mark]) + struct.pack(">H", len(s) + 2) + s for mark, s in segments)
    path.write_bytes(data[:2] + whole + data[2:])
    return path
