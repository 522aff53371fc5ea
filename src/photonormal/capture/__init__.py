"""Files -> Capture. One reader, one file; the folder's content decides which, or its name does."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from photonormal.options import LightsFrom
from photonormal.types import Capture, InputError, no_such

CROP = "crop.txt"  # x,y,width,height of what is read of the photographs beside it
UNKNOWN = Path("unknown")  # in place of a file with lights: they are to be found from the photographs
DEMO = Path(__file__).parents[1] / "data" / "demo"  # a rendered capture with true normals, part of the package

FORMATS = {  # name -> "module", with `matches(path)` and `read(path, choice)`; the first that matches reads
    "diligent": "photonormal.capture.diligent",
    "luces": "photonormal.capture.luces",
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
    intensities: str | Path | None = None,
    dark: str | Path | None = None,
    flat: str | Path | None = None,
    lens: str | Path | None = None,
    memory: str = "",
    crop: str | Sequence[int] = "",
    scale: float = 1.0,
    **choices: Any,
) -> Capture:
    """Photographs, mask and light directions of one object.

    Pictures are decoded when they are needed, in threads, and only the box around the mask is kept.

    Parameters
    ----------
    path : folder of a capture, an `.lp` file, or "demo": the capture that comes with the package
    format : a key of FORMATS, or "auto": the first that fits what the folder holds
    images : subset by 1-based numbers, "1-10,15"; empty: all
    lights : file with light directions, instead of the capture's own; "unknown": neither these nor intensities are
        read, and are found from the photographs when the capture is measured
    mask : mask picture, instead of the capture's own
    srgb : the pictures are sRGB-encoded and have to be linearised; otherwise what their files say is believed
    intensities : file with light intensities, instead of the capture's own
    dark, flat : pictures taken with all lights off, and of an even white surface: subtracted, and divided by; `flat`
        may be a folder with one of a white board for each light, which fall-off and intensity are taken from
    lens : calibration that OpenCV wrote, whose distortion is taken out
    memory : how much this process may use from now on, such as "3GB"; empty: as before, half of what is free at first.
        An eighth of it bounds what one file may take when it is decoded
    crop : "x,y,width,height", or those numbers: the part of the photographs that is read, in pixels. Empty: what
        `crop.txt` beside the photographs says, or all of them. Lamps, camera, mask, truth, dark frame and flat field
        are those of the whole photographs, and follow
    scale : by which photographs are reduced, 0.5 halves both sides; linear radiance is averaged over areas
    choices : `lights_as`, `ring`, `elevation`, `start`, `clockwise`, `rgb_lights`, `prefer`, `mask_on`, `linear`,
        `exif_exposure`, `hot_pixels`, `frame`, and for near lights `mm_per_px`, `dome_radius_mm` and
        `focal_px`, see `photonormal.capture.assemble.Choice`

    Raises
    ------
    InputError
        In one line: what came, what was needed, what to do.
    """
    from photonormal.capture.assemble import Choice
    from photonormal.files.memory import allow

    allow(memory)
    if format != "auto" and format not in FORMATS:
        raise no_such("format", format, ["auto", *FORMATS])
    path = Path(path)
    files = {"lights": lights, "mask": mask, "intensities": intensities, "dark": dark, "flat": flat, "lens": lens}
    given = {name: Path(file) for name, file in files.items() if file}
    choice = Choice(images=images, srgb=srgb, crop=crop, scale=scale, **given, **choices)
    try:
        path = place_of(path)
        if not path.exists():
            raise InputError(f"{path} does not exist; give the folder of a capture or an .lp file.")
        if not path.is_dir() and format != "rti" and not (format == "auto" and path.suffix.lower() == ".lp"):
            raise InputError(f"{path} is a file but the folder of a capture, or an .lp file, is needed; give that.")
        readers = (import_module(FORMATS[name]) for name in (FORMATS if format == "auto" else [format]))
        reader = next(r for r in readers if format != "auto" or r.matches(path))
        beside = path if path.is_dir() else path.parent
        if not choice.crop:
            choice = replace(choice, crop=own_crop(beside), crop_file=beside / CROP)
        return reader.read(path, choice)
    except OSError as error:
        raise InputError(
            f"{error.filename or path} can't be read ({error.strerror}); check the path and its permissions."
        ) from None


def place_of(path: Path) -> Path:
    """Where a capture lies: `path`, or in the package for "demo"."""
    return DEMO if path == Path("demo") and not path.exists() else path


def own_crop(folder: Path) -> str:
    """What the file with a crop beside photographs says; empty where there is none.

    DiLiGenT's objects have a file of that name without commas: rows and columns around the mask, which nothing needs.
    """
    from photonormal.capture.texts import read_lines

    text = " ".join(read_lines(folder / CROP)) if (folder / CROP).is_file() else ""
    return "" if re.fullmatch(r"\d+(\s+\d+){3}", text) else text


def intensities_of(capture: Capture) -> np.ndarray | None:
    """The intensities (n,) that a capture's files were divided by, as grey levels; None where they have none."""
    from photonormal.shading import LUMA

    e = np.asarray(getattr(files_behind(capture), "intensities", np.ones((1, 1))))
    grey = e @ np.array(LUMA) if e.shape[1] == 3 else e[:, 0]
    return None if np.ptp(grey) == 0 else grey


def files_behind(capture: Capture) -> Any:
    """The `ImageFiles` behind pictures that are corrected or cropped; the pictures themselves where there are none."""
    images: Any = capture.images
    while hasattr(images, "images"):
        images = images.images
    return images


def files_read(path: str | Path, capture: Capture, *others: Any) -> list[Path]:
    """The folder, the pictures and those of `others` that are paths: what must not be written over by results."""
    from photonormal.capture.images import files_of

    path = Path(path)
    pictures = [file for picture in getattr(files_behind(capture), "pictures", ()) for file in files_of(picture)]
    return [path, *([path.parent] if path.is_file() else []), *pictures, *(p for p in others if isinstance(p, Path))]


def reading_told(path: str | Path, how: dict[str, Any], capture: Capture) -> dict[str, Any]:
    """How a capture was read, for reports: its `source`, the options of `load` under `reading`, and the `encoding` that
    its samples were taken to have; paths are absolute."""
    source = str(Path(path).resolve()) if Path(path).exists() else str(path)
    files = {key: str(v if v == UNKNOWN else v.resolve()) for key, v in how.items() if isinstance(v, Path)}
    reading = {key: v for key, v in how.items() if v} | files
    return {"source": source, "reading": reading} | ({"encoding": capture.encoding} if capture.encoding else {})


def lights_from(lights: Path | None, refine: bool) -> LightsFrom:
    """Where the lights come from, by --lights and --refine-lights."""
    if lights == UNKNOWN and refine:
        raise InputError("--refine-lights came with --lights unknown but it mends lights that are given; drop one.")
    return "unknown" if lights == UNKNOWN else "refined" if refine else "given"
