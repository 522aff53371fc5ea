"""Files -> Capture. One reader, one file; the folder's content decides which, or its name does."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from photonormal.types import Capture, InputError

DEMO = Path(__file__).parents[1] / "data" / "demo"  # a rendered capture with true normals, part of the package

FORMATS = {  # name -> "module", with `matches(path)` and `read(path, choice)`; the first that matches reads
    "diligent": "photonormal.capture.diligent",
    "rti": "photonormal.capture.rti",
    "blobby": "photonormal.capture.blobby",
    "cyclesps": "photonormal.capture.cyclesps",
    "lightstage": "photonormal.capture.lightstage",
    "folder": "photonormal.capture.folder",
}


def load(
    path: str | Path,
    format: str = "auto",
    images: str = "",
    lights: str | Path | None = None,
    mask: str | Path | None = None,
    srgb: bool = False,
) -> Capture:
    """Photographs, mask and light directions of one object.

    Pictures are decoded when they are needed, in threads, and only the box around the mask is kept.

    Parameters
    ----------
    path : folder of a capture, an `.lp` file, or "demo": the capture that comes with the package
    format : a key of FORMATS, or "auto": the first that fits what the folder holds
    images : subset by 1-based numbers, "1-10,15"; empty: all
    lights : file with light directions, instead of the capture's own
    mask : mask picture, instead of the capture's own
    srgb : the pictures are sRGB-encoded (camera JPEGs are) and have to be linearised

    Raises
    ------
    InputError
        In one line: what came, what was needed, what to do.
    """
    from photonormal.capture.assemble import Choice

    path = Path(path)
    if path == Path("demo") and not path.exists():
        path = DEMO
    if not path.exists():
        raise InputError(f"{path} does not exist; give the folder of a capture or an .lp file.")
    if format != "auto" and format not in FORMATS:
        raise InputError(f"no format {format!r}; choose from auto, {', '.join(FORMATS)}.")
    choice = Choice(images, Path(lights) if lights else None, Path(mask) if mask else None, srgb)
    names = FORMATS if format == "auto" else [format]
    for name in names:
        reader = import_module(FORMATS[name])
        if format != "auto" or reader.matches(path):
            return reader.read(path, choice)
    raise InputError(
        f"{path} is no capture that can be told by its content; it needs pictures with light_directions.txt, lights.csv "
        f"or an .lp file, or name one of {', '.join(FORMATS)} with --format."
    )
