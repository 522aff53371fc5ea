"""What a camera wrote about a picture: exposure, and whether its samples are sRGB-encoded.

Exif is a small TIFF inside a JPEG, PNG or TIFF file; most cameras' RAW files are TIFF files themselves.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.files.opening import open_file
from photonormal.types import InputError

EXPOSURE, F_NUMBER, ISO, EXIF, COLOUR_SPACE = 0x829A, 0x829D, 0x8827, 0x8769, 0xA001
TYPES = {1: "B", 3: "H", 4: "I", 5: "II", 9: "i", 10: "ii"}  # Exif's kinds of numbers
READ = 2**20  # bytes of a file that are looked at: Exif comes first


@dataclass(frozen=True)
class Exif:
    """Exposure time in seconds, f-number, ISO speed, each None where it was not written; `srgb` True if so declared."""

    exposure_s: float | None = None
    f_number: float | None = None
    iso: float | None = None
    srgb: bool = False

    def exposure(self) -> float | None:
        """t ISO / (100 N^2): what scales a picture's brightness; None without an exposure time."""
        if not self.exposure_s:
            return None
        return self.exposure_s * (self.iso or 100) / 100 / (self.f_number or 1) ** 2


def read_exif(path: Path) -> Exif:
    """What Exif says; nothing where a file has none or a damaged one."""
    try:
        with open_file(path) as file:
            data = file.read(READ)
        tiff = _tiff(data)
        tags = _tags(tiff) if tiff else {}
    except (OSError, struct.error, ValueError, IndexError, OverflowError):
        return Exif()
    return Exif(tags.get(EXPOSURE), tags.get(F_NUMBER), tags.get(ISO), tags.get(COLOUR_SPACE) == 1)


def declared_srgb(path: Path) -> bool:
    """True for a JPEG whose Exif data declares sRGB: cameras encode theirs; exported PNG and TIFF may be linear."""
    return path.suffix.lower() in (".jpg", ".jpeg") and read_exif(path).srgb


def exposures(paths: Sequence[Path]) -> np.ndarray:
    """Exposures (n, 1) of the pictures by their Exif, their mean 1.

    Raises
    ------
    InputError
        If a picture has none, or some tell ISO or f-number and others don't.
    """
    found = [read_exif(p) for p in paths]
    absent = [p.name for p, e in zip(paths, found, strict=True) if e.exposure() is None]
    if absent:
        more = f" and {len(absent) - 1} more" if len(absent) > 1 else ""
        raise InputError(
            f"{absent[0]}{more} tell no exposure time in their Exif data but --exif-exposure needs it; "
            "give light_intensities.txt instead, or the pictures as the camera wrote them."
        )
    for what in ("iso", "f_number"):
        if len({getattr(e, what) is None for e in found}) == 2:
            raise InputError(
                f"some pictures tell their {what.replace('_', '-')} in Exif and others don't, so exposures can't "
                "be compared; give light_intensities.txt instead."
            )
    e = np.array([[x.exposure()] for x in found], dtype=np.float64)
    return e / e.mean()


def _tiff(data: bytes) -> bytes | None:
    """The TIFF structure inside a file, or None."""
    if data[:4] in (b"II*\0", b"MM\0*"):
        return data
    if data.startswith(b"\xff\xd8"):
        at = 2
        while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
            length = int.from_bytes(data[at + 2 : at + 4], "big")
            if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
                return data[at + 10 : at + 2 + length]
            at += 2 + length
    if data.startswith(b"\x89PNG"):
        at = 8
        while at + 12 <= len(data):
            length = int.from_bytes(data[at : at + 4], "big")
            if data[at + 4 : at + 8] == b"eXIf":
                return data[at + 8 : at + 8 + length]
            at += 12 + length
    return None


def _tags(tiff: bytes) -> dict[int, float]:
    """The numbers of the first directory and of Exif's own."""
    order = "<" if tiff[:2] == b"II" else ">"
    tags: dict[int, float] = {}
    places = [struct.unpack_from(order + "I", tiff, 4)[0]]
    for place in places:
        for k in range(struct.unpack_from(order + "H", tiff, place)[0]):
            tag, kind, count = struct.unpack_from(order + "HHI", tiff, place + 2 + 12 * k)
            if kind not in TYPES or not count:
                continue
            form = order + TYPES[kind]
            at = place + 10 + 12 * k
            if struct.calcsize(form) * count > 4:
                at = struct.unpack_from(order + "I", tiff, at)[0]
            value = struct.unpack_from(form, tiff, at)
            tags.setdefault(tag, value[0] / value[1] if len(value) == 2 and value[1] else float(value[0]))
            if tag == EXIF and len(places) == 1:
                places.append(int(value[0]))
    return tags
