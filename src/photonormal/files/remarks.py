"""What a picture file says about itself beside its samples."""

from __future__ import annotations

from pathlib import Path

from photonormal.files import exr
from photonormal.files.chatter import heard
from photonormal.files.opening import open_file
from photonormal.png import remarks, texts

EXR_START = b"\x76\x2f\x31\x01"


def is_srgb(path: Path) -> bool:
    """Whether a PNG says that its samples are sRGB-encoded."""
    with open_file(path) as file:
        return any(kind == b"sRGB" for kind, _ in remarks(file))


def remark(path: Path, key: str) -> str | None:
    """The remark of that name in a PNG or OpenEXR file; None where there is none."""
    with open_file(path) as file:
        if file.read(4) != EXR_START:
            return texts(file).get(key)
        found, _ = heard(lambda: exr.attribute(file, key))
        return found if isinstance(found, str) else None
