"""The last step of every reader: picture files, lights and a mask become one Capture."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np

from photonormal.capture import UNKNOWN
from photonormal.capture.corrections import MOST_WHITE, Corrected, FlatFields, flat_field, hot_pixels, read_frame
from photonormal.capture.cropped import cropped
from photonormal.capture.encoding import JPEG, doubtful, encoding_told, encodings
from photonormal.capture.exif import exposures, exposures_told
from photonormal.capture.images import MARGIN, ImageFiles, Picture, files_of, picture_name, picture_size, planes
from photonormal.capture.lens import Lens, read_lens
from photonormal.capture.lights import read_lights
from photonormal.capture.lights.match import in_order_of
from photonormal.capture.lights.near import long_directions, placed_lamps
from photonormal.capture.lights.ring import ring
from photonormal.capture.lights.table import Listed
from photonormal.capture.orientation import read_drawn, ring_note
from photonormal.capture.pictures import counts_differ, pages, parse_images, refuse_repeated, white_boards
from photonormal.capture.texts import read_intensities
from photonormal.crop import Crop
from photonormal.files.decode import decode, full_scale
from photonormal.geometry import from_frame
from photonormal.masked import box_of
from photonormal.types import Camera, Capture, InputError, Lamps, Normals, unit_lights


@dataclass(frozen=True)
class Choice:
    """What a user may say about a capture beyond its folder.

    Parameters
    ----------
    images : a subset by 1-based numbers, "1-10,15"; empty: all
    lights : file with light directions, instead of the folder's own (`photonormal.capture.lights`); UNKNOWN: neither
        the folder's lights nor its intensities are believed
    lights_as : what that file's numbers are, see `photonormal.capture.lights.read_lights`
    ring, elevation, start, clockwise : lamps at equal steps around the object, instead of a file
        (`photonormal.capture.lights.ring`)
    rgb_lights : each photograph shows three lights at a time, one in red, one in green and one in blue
    prefer : which kind of file to take where pictures are there in two kinds, such as RAW and JPEG
    mask : mask picture, instead of the folder's own
    mask_on : what a mask was drawn on: "stored" samples, or pictures as viewers show them ("shown"); empty: what fits
    srgb : the pictures are sRGB-encoded and have to be linearised, whatever their files say
    linear : they are linear, whatever their files say, which is believed otherwise (`photonormal.capture.encoding`)
    intensities : file with light intensities (n, 1 or 3), instead of the folder's own
    exif_exposure : divide by the exposures that the pictures state in their Exif data
    dark, flat : pictures taken with all lights off, and of an even white surface: subtracted, and divided by; `flat`
        may be a folder with one of a white board for each light, which fall-off and intensity are taken from
    hot_pixels : replace pixels that stand out of their surroundings in `dark`, or in every picture
    lens : calibration that OpenCV wrote, whose distortion is taken out
    frame : frame of the light directions, a key of photonormal.geometry.FRAMES
    mm_per_px : side of a pixel at the object's depth; lights are then near, and their file holds positions in mm
    dome_radius_mm : the file holds directions nevertheless, of lamps this far from the object at the picture's middle
    focal_px : focal length of a camera whose perspective matters
    crop : "x,y,width,height", or those numbers, in pixels of the photographs: what of them is read; empty: all.
        Everything else that is given in pixels counts in the whole photographs
    scale : by which photographs are reduced, linear ones averaged over areas; above 0 and at most 1
    crop_file : file that `crop` was read from, for messages
    """

    images: str = ""
    lights: Path | None = None
    lights_as: str = ""
    ring: int | None = None
    elevation: float | None = None
    start: float = 0.0
    clockwise: bool = False
    rgb_lights: bool = False
    prefer: str = ""
    mask: Path | None = None
    mask_on: str = ""
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
    crop: str | Sequence[int] = ""
    scale: float = 1.0
    crop_file: Path | None = None

    def not_pictures(self) -> list[Path | None]:
        """Files that it names, which are no photographs under one light."""
        return [self.dark, self.flat, self.mask, self.lights, self.intensities]


def assemble(
    name: str,
    pictures: Sequence[Path | tuple[Path, ...]],
    lights: np.ndarray | Listed | None,
    choice: Choice,
    intensities: np.ndarray | Path | None = None,
    mask: Path | np.ndarray | None = None,
    truth: np.ndarray | Callable[[tuple[int, int]], np.ndarray] | None = None,
    lamps: Lamps | None = None,
    camera: Camera | None = None,
) -> Capture:
    """A Capture of the chosen pictures.

    `lights` is (n, 3) for the n `pictures`, as written, or what a file lists, or None where there are none or `lamps`,
    `intensities` (n, 1 or 3), their file, or None (all 1), `truth` (h, w, 3) with zero or NaN where unknown, or what
    reads it for pictures of (h, w).
    """
    if choice.lights == UNKNOWN:
        lights = intensities = lamps = camera = None
    lit = _lit(name, pictures, lights, intensities, choice)
    used, e = lit.pictures, lit.intensities
    boards = _boards(choice, lit, near=lamps is not None)
    if boards is not None:
        e = np.ones((len(used), 1))  # they have them in them
    undivided = boards is None and np.ptp(e) == 0 and not choice.exif_exposure and choice.lights != UNKNOWN
    e = e * _exposures(used, choice)
    frame = picture_size(used[0])
    crop = Crop.chosen(choice.crop, choice.scale, frame, str(choice.crop_file or "--crop"))
    margin = MARGIN if crop is None else MARGIN + ceil(1 / crop.scale)
    mask = mask if choice.mask is None else choice.mask
    said = encodings([files_of(p)[0] for p in used], choice.srgb, choice.linear)
    notes = [*lit.notes, *doubtful(said)]
    if undivided:
        notes += exposures_told([files_of(p)[0] for p in used])
    if isinstance(mask, Path):
        mask, turned = read_drawn(mask, used, choice.mask_on)
        notes += turned
    if choice.ring is not None:
        notes += ring_note(used)
    lens = read_lens(choice.lens) if choice.lens else None
    if lens is not None and mask is not None:
        mask = lens.undistorted(mask.astype(np.uint8), nearest=True) > 0
    if crop is not None and (mask is None or mask.shape == frame):
        mask = crop.inside(mask)
    samples = ImageFiles(used, None if choice.lens else mask, e, said, distinct=True, margin=margin)
    flats = None
    if boards is not None:
        flats = boards, None if lit.vectors is None else unit_lights(lit.vectors, [picture_name(p) for p in used])[:, 2]
    images = corrected(samples, choice, lens, None if mask is None else box_of(mask, margin), flats)
    if lamps is None:
        lamps, camera = placed_lamps(lit.vectors, choice.mm_per_px, choice.dome_radius_mm, choice.focal_px, frame)
        notes += long_directions(lit.vectors, lamps)
    else:
        lamps = lamps[lit.chosen]
    given = truth(frame) if callable(truth) else truth
    capture = Capture(
        images=images,
        mask=np.ones(frame, bool) if mask is None else mask,
        lights=lit.vectors,
        lamps=lamps,
        camera=camera,
        truth=None if given is None else known_normals(given),
        saturation=samples.saturation,
        name=name,
        image_names=tuple(picture_name(p) for p in used),
        notes=tuple(notes),
        encoding=encoding_told(samples.encodings),
        linearised=any(encoding.curves for encoding in samples.encodings),
        likely_encoded=JPEG in samples.encodings,
    )
    return capture if crop is None else cropped(capture, images, crop)


@dataclass(frozen=True)
class LitPictures:
    """The pictures that are used, each under a light.

    Parameters
    ----------
    chosen : which they are of all that have a light, `every`
    vectors : (n, 3) to the lights, in our frame, or None
    intensities : (n, 1 or 3)
    notes : what the user should know
    """

    pictures: list[Picture]
    chosen: list[int]
    every: list[Picture]
    vectors: np.ndarray | None
    intensities: np.ndarray
    notes: tuple[str, ...] = ()


def _lit(
    name: str,
    files: Sequence[Path | tuple[Path, ...]],
    lights: np.ndarray | Listed | None,
    intensities: np.ndarray | Path | None,
    choice: Choice,
) -> LitPictures:
    """The files' pictures that the user chooses and that have a light; what is not used is not counted."""
    if not files:
        raise InputError(f"{name} holds no pictures; give a folder with PNG, TIFF, JPEG, EXR, TGA, NPY or RAW files.")
    pictures = [page for p in files for page in (pages([p]) if isinstance(p, Path) else [p])]
    if choice.rgb_lights:
        pictures = [plane for picture in pictures for plane in planes(picture)]
    listed = _listed(lights, choice)
    order, rows, notes = list(range(len(pictures))), [], []
    if listed is not None:
        order, rows, notes = in_order_of([picture_name(p) for p in pictures], listed)
    every = [pictures[j] for j in order]
    chosen = parse_images(choice.images, len(every))
    used = [every[j] for j in chosen]
    _refuse_missing(used, name)
    refuse_repeated(used)
    vectors = None
    if listed is not None:
        if len(rows) not in (len(every), len(used)):
            raise counts_differ(name, used, len(rows), listed.source)
        rows = rows if len(rows) == len(used) else [rows[j] for j in chosen]
        vectors = from_frame(listed.vectors[rows], choice.frame if choice.ring is None else "opengl")
        notes = [*listed.notes, *notes]
        if listed.intensities is not None and intensities is None:
            intensities = listed.intensities[rows]
    e = _intensities(choice.intensities or intensities, [len(used), len(every), len(pictures)], order, chosen)
    return LitPictures(used, chosen, every, vectors, e, tuple(notes))


def _exposures(pictures: Sequence[Picture], choice: Choice) -> np.ndarray:
    """By which the pictures are divided, (n, 1): as their Exif says where the user asks for it, else 1."""
    return exposures([files_of(p)[0] for p in pictures]) if choice.exif_exposure else np.ones((len(pictures), 1))


def _listed(lights: np.ndarray | Listed | None, choice: Choice) -> Listed | None:
    """The lights that the user names, or else those that the reader found."""
    if choice.ring is not None and choice.lights is not None:
        raise InputError(
            f"--ring {choice.ring} came with --lights {choice.lights} but one of them is needed; drop one."
        )
    if choice.ring is not None:
        return Listed(None, [], ring(choice.ring, choice.elevation, choice.start, choice.clockwise))
    for name in ("elevation", "start", "clockwise"):
        option = f"--{name}"
        if getattr(choice, name) != getattr(Choice, name):
            raise InputError(f"{option} came without --ring but it says how lamps stand in one; add how many they are.")
    if choice.lights is not None and choice.lights != UNKNOWN:
        return read_lights(choice.lights, choice.lights_as)
    return Listed(None, [], lights) if isinstance(lights, np.ndarray) else lights


def _refuse_missing(pictures: Sequence[Picture], name: str) -> None:
    files = [path for picture in pictures for path in files_of(picture)]
    missing = [path for path in files if not os.path.exists(path) or os.path.isdir(path)]
    if missing:
        more = f", and {len(missing) - 1} more," if len(missing) > 1 else ""
        raise InputError(
            f"picture {missing[0]} is missing{more} but {name} is to be read with it; restore it, correct the list "
            "that names it, choose others with --images, or name a file with lights for the pictures that are there "
            "with --lights."
        )


def _intensities(given: np.ndarray | Path | None, counts: list[int], order: list[int], chosen: list[int]) -> np.ndarray:
    """Intensities (n, 1 or 3) of the pictures used; given for those, for all with a light, or for all there are."""
    used, with_light, every = counts
    if given is None:
        return np.ones((used, 1))
    table = read_intensities(given, *counts) if isinstance(given, Path) else given
    if len(table) == every and every != with_light:
        table = table[order]
    return table if len(table) == used else table[chosen]


def _boards(choice: Choice, lit: LitPictures, near: bool) -> list[Path] | None:
    """Pictures of a white board under each light, whose fall-off and intensity they show, where there are some."""
    if choice.flat is None or not (choice.rgb_lights or choice.flat.is_dir()):
        return None
    if near or choice.mm_per_px is not None:
        raise InputError(
            f"--flat {choice.flat} shows how light falls off, and so do the lamps' positions; "
            "leave --flat or --mm-per-px out."
        )
    if choice.rgb_lights and choice.flat.is_dir():
        raise InputError(f"--flat {choice.flat} is a folder but --rgb-lights takes one flat field; give one picture.")
    if choice.rgb_lights:  # it shows the three lights, too
        return [choice.flat] * len(lit.pictures)
    found = white_boards(choice.flat, [picture_name(p) for p in lit.every])
    return [found[j] for j in lit.chosen]


def corrected(
    files: ImageFiles,
    choice: Choice,
    lens: Lens | None,
    box: tuple[slice, slice] | None,
    flats: tuple[list[Path], np.ndarray | None] | None,
) -> ImageFiles | Corrected:
    """The pictures without what `choice` names: dark level, flat field, hot pixels, and the lens's distortion.

    `flats` are pictures of a white board, one for each light, and the lights' cosines, where they are known.
    """
    shape, encoding = (*files.frame, 3 if choice.rgb_lights else files.shape[3]), files.encodings[0]
    dark = read_frame(choice.dark, shape, "dark frame", encoding) if choice.dark else None
    flat = None
    if flats is not None:
        flat = FlatFields(flats[0], shape, dark, encoding, flats[1], _exposures(flats[0], choice)[:, 0])
    elif choice.flat:
        flat = flat_field(read_frame(choice.flat, shape, "flat field", encoding, MOST_WHITE), dark, choice.flat)
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


def coded_normals(path: Path, frame: tuple[int, int] | None = None) -> np.ndarray:
    """The normals that a picture, of the size `frame` where that is given, codes as (n + 1) / 2."""
    samples = decode(path, frame)
    return 2 * (samples / full_scale(samples)) - 1


def known_normals(map: np.ndarray) -> Normals:
    """Normals whose mask is where the given map (h, w, 3) has vectors of about unit length."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(map, axis=-1)
    known = np.abs(length - 1) < 0.1  # 8-bit maps are off by a few per cent; background codes are near 0
    unit = np.zeros(map.shape, np.float32)
    unit[known] = map[known] / length[known][:, None]
    return Normals(unit, known)
