"""What is embedded in a picture file beside its samples: Exif's tags and a colour profile, of JPEG, PNG, TIFF and RAW.

Exif is a small TIFF inside a JPEG or PNG file; most cameras' RAW files are TIFF files themselves.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from photonormal.files.opening import open_file
from photonormal.files.plain import JPEG_SCAN, JPEG_START, PNG_START
from photonormal.png import remarks

ICC, EXIF, INTEROPERABILITY = 0x8773, 0x8769, 0xA005  # tags: a profile, and places of further directories
NUMBERS = {1: "B", 3: "H", 4: "I", 5: "II", 9: "i", 10: "ii", 13: "I", 16: "Q"}  # kinds of TIFF's values
BYTES = {2, 7}
READ = {ICC, 0x0001}  # tags whose bytes are read: the profile, and which rules of interoperability hold
LONGEST = 4 * 2**20  # bytes of a profile, at most
MOST = 500  # entries of a directory, and segments of a JPEG file before its samples


@dataclass(frozen=True)
class Embedded:
    """What is embedded in a file.

    Parameters
    ----------
    tags : of the first directory and of Exif's own, numbers or bytes
    profile : ICC
    srgb : PNG says that samples are sRGB-encoded
    jpeg : the file is a JPEG
    """

    tags: dict[int, float | bytes] = field(default_factory=dict)
    profile: bytes | None = None
    srgb: bool = False
    jpeg: bool = False

    def number(self, tag: int) -> float | None:
        """The number of that tag, None where there is none."""
        value = self.tags.get(tag)
        return value if isinstance(value, float) else None


def embedded(path: Path) -> Embedded:
    """What a file says, by its content, whatever its name; nothing where it has nothing or it is damaged."""
    try:
        with open_file(path) as file:
            start = file.read(8)
            if start.startswith(JPEG_START):
                return _of_jpeg(file)
            if start == PNG_START:
                return _of_png(file)
            if start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
                tags = _tags(file)
                profile = tags.get(ICC)
                return Embedded(tags, profile if isinstance(profile, bytes) else None)
    except (OSError, struct.error, ValueError, IndexError, OverflowError, zlib.error):
        pass
    return Embedded()


def _of_jpeg(file: BinaryIO) -> Embedded:
    """Profiles come in parts: APP2 segments with their number, counted from 1, and how many there are."""
    tags: dict[int, float | bytes] = {}
    parts: dict[int, bytes] = {}
    file.seek(2)
    for _ in range(MOST):
        head = file.read(4)
        if len(head) < 4 or head[0] != 0xFF or head[1] == JPEG_SCAN[1]:
            break
        if head[1] == 0xFF:  # a filler
            file.seek(-3, 1)
            continue
        segment = file.read(int.from_bytes(head[2:], "big") - 2)
        if head[1] == 0xE1 and segment.startswith(b"Exif\0\0") and not tags:
            tags = _sound_tags(segment[6:])
        if head[1] == 0xE2 and segment.startswith(b"ICC_PROFILE\0"):
            parts[segment[12]] = segment[14:]
    return Embedded(tags, b"".join(parts[k] for k in sorted(parts)) or None, jpeg=True)


def _of_png(file: BinaryIO) -> Embedded:
    chunks = dict(remarks(file, LONGEST))
    profile = None
    if b"iCCP" in chunks:  # a name, 0, 0 for deflate, and the compressed profile
        try:
            profile = zlib.decompressobj().decompress(chunks[b"iCCP"].split(b"\0", 1)[1][1:], LONGEST)
        except (IndexError, zlib.error):
            profile = b""
    return Embedded(_sound_tags(chunks.get(b"eXIf", b"")), profile, b"sRGB" in chunks)


def _sound_tags(tiff: bytes) -> dict[int, float | bytes]:
    """The tags of Exif's block; none where it is damaged, which says nothing against a profile beside it."""
    try:
        return _tags(BytesIO(tiff)) if tiff else {}
    except (struct.error, ValueError, IndexError, OverflowError):
        return {}


def _tags(tiff: BinaryIO) -> dict[int, float | bytes]:
    """What the first directory of a TIFF holds, and those of Exif that it names."""
    tiff.seek(0)
    start = tiff.read(16)
    order = "<" if start[:2] == b"II" else ">"
    big = start[2:4] in (b"+\0", b"\0+")
    offset, count, entry = ("Q", "Q", "HHQ") if big else ("I", "H", "HHI")
    inline = struct.calcsize(offset)
    tags: dict[int, float | bytes] = {}
    places = [struct.unpack_from(order + offset, start, inline)[0]]
    for place in places:
        tiff.seek(place)
        entries = struct.unpack(order + count, tiff.read(struct.calcsize(count)))[0]
        size = struct.calcsize(order + entry) + inline
        data = tiff.read(min(entries, MOST) * size)
        for at in range(0, len(data) - size + 1, size):
            tag, kind, length = struct.unpack_from(order + entry, data, at)
            form = f"{length}s" if kind in BYTES else NUMBERS.get(kind, "")
            step = length if kind in BYTES else struct.calcsize(order + form) * length
            if not form or not length or step > LONGEST or (kind in BYTES and tag not in READ):
                continue
            field_at = at + size - inline
            if step > inline:
                tiff.seek(struct.unpack_from(order + offset, data, field_at)[0])
                value = struct.unpack_from(order + form, tiff.read(step))
            else:
                value = struct.unpack_from(order + form, data, field_at)
            tags.setdefault(tag, _value(value))
            if tag in (EXIF, INTEROPERABILITY) and kind not in BYTES and len(places) < 3:
                places.append(int(value[0]))
    return tags


def _value(value: tuple) -> float | bytes:
    if isinstance(value[0], bytes):
        return value[0]
    return value[0] / value[1] if len(value) == 2 and value[1] else float(value[0])
