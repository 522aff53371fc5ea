"""The last step of every reader: picture files, lights and a mask become one Capture."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.capture.corrections import Corrected, flat_field, hot_pixels, read_frame
from photonormal.capture.exif import declared_srgb, exposures
from photonormal.capture.images import MARGIN, ImageFiles, Picture, parts, read_mask
from photonormal.capture.lens import Lens, read_lens
from photonormal.capture.lights import in_order_of, placed, read_lights
from photonormal.capture.texts import read_intensities
from photonormal.files.decode import SUFFIXES, frame_of
from photonormal.geometry import in_frame
from photonormal.types import Camera, Capture, Images, InputError, Lamps, Normals, box_of


@dataclass(frozen=True)
class Choice:
    """What a user may say about a capture beyond its folder.

    Parameters
    ----------
    images : a subset by 1-based numbers, "1-10,15"; empty: all
    lights : file with light directions, instead of the folder's own; `.lp`, CSV or a table
    mask : mask picture, instead of the folder's own
    srgb : the pictures are sRGB-encoded and have to be linearised
    linear : they are not, though 8-bit pictures say so in their Exif data, which is believed otherwise
    intensities : file with light intensities (n, 1 or 3), instead of the folder's own
    exif_exposure : divide by the exposures that the pictures tell in their Exif data
    dark, flat : pictures taken with all lights off, and of an even white surface: subtracted, and divided by
    hot_pixels : replace pixels that stand out of their surroundings in `dark`, or in every picture
    lens : calibration that OpenCV wrote, whose distortion is taken out
    frame : frame of the light directions, a key of photonormal.geometry.FRAMES
    mm_per_px : side of a pixel at the object's depth; lights are then near, and their file holds positions in mm
    dome_radius_mm : the file holds directions nevertheless, of lamps at this distance around the object's middle
    focal_px : focal length of a camera whose perspective matters
    """

    images: str = ""
    lights: Path | None = None
    mask: Path | None = None
    srgb: bool = False
    linear: bool = False
    intensities: Path | None = None
    exif_exposure: bool = False
    dark: Path | None = None
    flat: Path | None = None
    hot_pixels: bool = False
    lens: Path | None = None
    frame: str = "opengl"
    mm_per_px: float | None = None
    dome_radius_mm: float | None = None
    focal_px: float | None = None


def assemble(
    name: str,
    pictures: Sequence[Picture],
    lights: np.ndarray | None,
    choice: Choice,
    intensities: np.ndarray | None = None,
    mask: Path | np.ndarray | None = None,
    truth: np.ndarray | Callable[[tuple[int, int]], np.ndarray] | None = None,
    lamps: Lamps | None = None,
    camera: Camera | None = None,
) -> Capture:
    """A Capture of the chosen pictures.

    `lights` is (n, 3) for the n `pictures`, as written, or None where there are none or `lamps`, `intensities` (n, 1 or
    3) or None (all 1), `truth` (h, w, 3) with zero or NaN where unknown, or what reads it for pictures of (h, w).
    """
    n = len(pictures)
    if not n:
        raise InputError(f"{name} holds no pictures; give a folder with PNG, TIFF, JPEG, TGA, EXR, NPY or RAW files.")
    names = [parts(p)[0].name for p in pictures]
    if choice.lights is not None:
        lights = in_order_of(names, *read_lights(choice.lights), choice.lights)
    if lights is not None and len(lights) != n:
        raise InputError(
            f"{name} has {n} pictures but {len(lights)} light directions; give one direction for each picture, "
            "in the same order, and remove pictures that are not part of the capture."
        )
    if lights is not None:
        lights = in_frame(lights, choice.frame)
    chosen = parse_images(choice.images, n)
    files = [path for j in chosen for path in parts(pictures[j])]
    missing = [path for path in files if not os.path.exists(path) or os.path.isdir(path)]
    if missing:
        more = f", and {len(missing) - 1} more," if len(missing) > 1 else ""
        raise InputError(
            f"picture {missing[0]} is missing{more} but {name} is to be read with it; restore it, correct the list "
            "that names it or choose others with --images."
        )
    refuse_repeated(files)
    if choice.intensities is not None:
        intensities = read_intensities(choice.intensities, n)
    if intensities is None:
        intensities = np.ones((n, 1))
    if choice.exif_exposure:
        intensities = intensities * exposures([parts(p)[0] for p in pictures])
    if choice.mask is not None:
        mask = choice.mask
    if isinstance(mask, Path):
        mask = read_mask(mask, frame_of(files[0]))
    srgb = choice.srgb or (not choice.linear and declared_srgb(parts(pictures[chosen[0]])[0]))
    box = None if choice.lens else mask
    samples = ImageFiles([pictures[j] for j in chosen], box, intensities[chosen], srgb, distinct=True)
    lens = read_lens(choice.lens) if choice.lens else None
    if lens is not None and mask is not None:
        mask = lens.undistorted(mask.astype(np.uint8), nearest=True) > 0
    images = corrected(samples, choice, lens, None if mask is None else box_of(mask, MARGIN))
    if lamps is None:
        h, w = samples.shape[1:3]
        lamps, camera = placed(lights, choice.mm_per_px, choice.dome_radius_mm, choice.focal_px, (h, w))
    given = truth(samples.shape[1:3]) if callable(truth) else truth
    return Capture(
        images=images,
        mask=np.ones(samples.shape[1:3], bool) if mask is None else mask,
        lights=None if lights is None else lights[chosen],
        lamps=None if lamps is None else lamps[chosen],
        camera=camera,
        truth=None if given is None else known_normals(given),
        saturation=samples.saturation,
        name=name,
        image_names=tuple(names[j] for j in chosen),
    )


def refuse_repeated(paths: Sequence[Path]) -> None:
    """Raise where two paths lead to one file: a photograph has one light."""
    seen: dict[tuple[int, int], Path] = {}
    for path in paths:
        status = os.stat(path)
        first = seen.setdefault((status.st_dev, status.st_ino), path)
        if first is not path:
            raise InputError(
                f"{first.name} is named {'twice' if first == path else f'again as {path.name}'} but a photograph has "
                "one light; correct the list that names it or choose others with --images."
            )


def corrected(files: ImageFiles, choice: Choice, lens: Lens | None, box: tuple[slice, slice] | None) -> Images:
    """The pictures without what `choice` names: dark level, flat field, hot pixels, and the lens's distortion."""
    shape, linear = files.shape[1:], files.linear
    dark = read_frame(choice.dark, shape, "dark frame", linear) if choice.dark else None
    flat = None
    if choice.flat:
        flat = flat_field(read_frame(choice.flat, shape, "flat field", linear), dark, choice.flat)
    hot = None
    if choice.hot_pixels:
        level = dark
        if level is None:
            level = files.decoded(0) * files.intensities[0]
            for j in range(1, len(files)):
                level = np.minimum(level, files.decoded(j) * files.intensities[j])
        hot = hot_pixels(level)
    if lens is None and dark is None and flat is None and hot is None:
        return files
    return Corrected(files, dark, flat, hot, lens, box)


def known_normals(map: np.ndarray) -> Normals:
    """Normals whose mask is where the given map (h, w, 3) has vectors of about unit length."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(map, axis=-1)
    known = np.abs(length - 1) < 0.1  # 8-bit maps are off by a few per cent; background codes are near 0
    unit = np.zeros(map.shape, np.float32)
    unit[known] = map[known] / length[known][:, None]
    return Normals(unit, known)


def parse_images(text: str, n: int, option: str = "--images") -> list[int]:
    """Zero-based indices from 1-based numbers and ranges, as `option` gives them.

    >>> parse_images("1-3,5", 6)
    [0, 1, 2, 4]
    """
    if not text.strip():
        return list(range(n))
    chosen: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*([0-9]{1,9})\s*(?:-\s*([0-9]{1,9})\s*)?", part)
        if match is None:
            raise InputError(
                f"{option} {text[:60]!r} has {part[:20]!r} but numbers and ranges like 1-10,15 are needed; correct it."
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if not 1 <= first <= last <= n:
            raise InputError(
                f"{option} {text[:60]!r} asks for {part.strip()} but this capture has 1 to {n}; choose from those."
            )
        chosen += range(first - 1, last)
    if len(set(chosen)) != len(chosen):
        raise InputError(f"{option} {text[:60]!r} names a picture twice; name each once.")
    return chosen


def natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sorting key that puts image 10 after image 9."""
    tokens = [t for t in re.split(r"([0-9]+)", path.name.lower()) if t]
    return [(int(t), "") if t[0] in "0123456789" else (-1, t) for t in tokens], path.name


def find_pictures(folder: Path) -> list[Path]:
    """Picture files of a folder in natural order, without masks, mattes and normal maps."""
    other = re.compile(
        r"(^|[._-])(mask|matte|normals?|normals?_gt|inboundary|onboundary|spheres|refused|preview)$", re.IGNORECASE
    )
    return sorted((p for p in _picture_files(folder) if not other.search(p.stem)), key=natural)


def find_mask(folder: Path) -> Path | None:
    """The folder's mask picture: `mask.*`, or a name that ends in `.mask` or `_mask`."""
    masks = [p for p in _picture_files(folder) if re.search(r"(^|[._-])mask$", p.stem, re.IGNORECASE)]
    if len(masks) > 1:
        raise InputError(
            f"{folder} has {len(masks)} masks ({', '.join(p.name for p in masks)}); choose one with --mask."
        )
    return masks[0] if masks else None


def _picture_files(folder: Path) -> list[Path]:
    return [
        p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith(".") and not p.is_dir()
    ]
