"""OpenEXR, by its own library."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from photonormal.files.chatter import heard
from photonormal.files.header import Header, damaged
from photonormal.files.opening import size_of
from photonormal.types import InputError

COLOURS = ("RGB", "RGBA", "Y")


def header(file: BinaryIO, path: Path) -> Header:
    """Size of the first part, and the bytes of all channels of all parts, which the library reads at once."""
    parts, _ = heard(lambda: _parts(file))
    if isinstance(parts, Exception):
        raise parts
    if not parts:
        raise damaged(path, "is truncated or damaged")
    sizes = [(int(y1) - int(y0) + 1, int(x1) - int(x0) + 1) for ((x0, y0), (x1, y1)), _ in parts]
    h, w = sizes[0]
    if min(min(size) for size in sizes) < 1:
        raise damaged(path, f"claims {w} x {h} pixels")
    return Header(h, w, sum(h * w * 4 * channels for (h, w), (_, channels) in zip(sizes, parts, strict=True)))


def _parts(file: BinaryIO) -> list[tuple[Any, int]]:
    """Data window and number of channels of each part."""
    import OpenEXR

    file.seek(0)
    with OpenEXR.File(BytesIO(file.read(size_of(file))), header_only=True) as exr:
        return [(part.header["dataWindow"], max(1, len(part.header["channels"]))) for part in exr.parts]


def attribute(file: BinaryIO, name: str) -> Any:
    """An attribute of the first part, None where it lacks it."""
    import OpenEXR

    file.seek(0)
    with OpenEXR.File(BytesIO(file.read(size_of(file))), header_only=True) as exr:
        return exr.parts[0].header.get(name) if exr.parts else None


def read(file: BinaryIO, path: Path) -> np.ndarray:
    """Samples (h, w) or (h, w, 3 or 4)."""
    import OpenEXR

    with OpenEXR.File(BytesIO(file.read(size_of(file)))) as exr:
        if not exr.parts:
            raise damaged(path, "is truncated or damaged")
        channels = exr.channels()
        for name in COLOURS:
            if name in channels and channels[name].pixels is not None:
                return np.asarray(channels[name].pixels)
    raise InputError(f"picture {path} has channels {', '.join(channels)} but R, G, B or Y is needed; export it again.")


class ExrRows:
    """An OpenEXR file of floats, 32 bits or `half` of them, written some rows after the other; `close` ends it."""

    def __init__(self, path: Path, size: tuple[int, int], colour: bool, half: bool) -> None:
        import Imath
        import OpenEXR

        header = OpenEXR.Header(size[1], size[0])
        kind = Imath.PixelType(Imath.PixelType.HALF if half else Imath.PixelType.FLOAT)
        self._names = "RGB" if colour else "Y"
        header["channels"] = dict.fromkeys(self._names, Imath.Channel(kind))
        self._file, self._dtype = OpenEXR.OutputFile(str(path), header), np.float16 if half else np.float32

    def write(self, rows: np.ndarray) -> None:
        """Append rows (n, w) or (n, w, 3)."""
        planes = np.moveaxis(rows.reshape(*rows.shape[:2], -1), 2, 0).astype(self._dtype, order="C")
        planes = {name: plane.tobytes() for name, plane in zip(self._names, planes, strict=True)}
        self._file.writePixels(planes, len(rows))

    def close(self) -> None:
        """Write what is left."""
        self._file.close()
