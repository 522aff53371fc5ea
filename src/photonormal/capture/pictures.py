"""Which files of a folder are photographs under one light each, and which of them are used."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from photonormal.capture.images import Picture, PicturePart, files_of, picture_name
from photonormal.capture.lights.match import stem
from photonormal.files.decode import JPEG, RAW, SUFFIXES, pages_of
from photonormal.types import InputError, a_few

T = TypeVar("T")

NO_PHOTOGRAPH = re.compile(  # how files are called that lie beside photographs: masks, normal maps, thumbnails, results
    r"(^|[._-])(mask|matte|normals?(_?map)?|normals?_gt|gt_normals?|inboundary|onboundary|spheres|refused|preview|thumb(nail)?s?"
    r"|albedo|expected-error)$|^(error|lights?|light_directions|light_intensities|corrected|depth"
    r"|base_colour|roughness|metalness|specular|material_known)$",
    re.IGNORECASE,
)
PREFER = {"raw": RAW, "jpeg": JPEG, "tiff": {".tif", ".tiff"}, "png": {".png"}, "exr": {".exr"}}
UNREAD = {  # pictures of kinds that are not read
    *(".heic", ".heif", ".webp", ".gif", ".psd", ".xcf", ".jp2", ".jxl", ".avif", ".pdf", ".svg"),
    *(".mov", ".mp4", ".avi", ".rti", ".ptm", ".hdr", ".pfm", ".pgm", ".ppm"),
}


def find_pictures(folder: Path, without: Iterable[Path | None] = (), prefer: str = "") -> list[Path]:
    """Photographs of a folder in natural order.

    Parameters
    ----------
    without : files that are none, such as a dark frame
    prefer : which kind of file to take, a key of PREFER, where pictures are there in two kinds

    Raises
    ------
    InputError
        If pictures are there twice, as RAW and JPEG of one shot, and `prefer` does not say which to take.
    """
    if prefer and prefer not in PREFER:
        raise InputError(f"--prefer {prefer[:40]!r} came but one of {', '.join(PREFER)} is needed; correct it.")
    others = {os.path.realpath(p) for p in without if p is not None}
    found = [p for p in photographs(picture_files(folder)) if os.path.realpath(p) not in others]
    return _of_one_kind(found, folder, prefer)


def photographs(pictures: Iterable[Path]) -> list[Path]:
    """Those of the pictures that are called as photographs are, in natural order."""
    return sorted((p for p in pictures if not NO_PHOTOGRAPH.search(p.stem)), key=lambda p: natural(p.name))


def unnamed(pictures: Iterable[Path], named: Iterable[Path | None]) -> list[str]:
    """Photographs among the pictures that are neither named nor another file of a shot that is."""
    shots = {stem(p.name).casefold() for p in named if p is not None}
    return [p.name for p in photographs(pictures) if stem(p.name).casefold() not in shots]


def _of_one_kind(pictures: list[Path], folder: Path, prefer: str) -> list[Path]:
    """The pictures, one file of each shot."""
    shots: dict[str, list[Path]] = {}
    for path in pictures:
        shots.setdefault(path.stem.casefold(), []).append(path)
    kept = []
    for files in shots.values():
        chosen = [p for p in files if p.suffix.lower() in PREFER.get(prefer, ())] if len(files) > 1 else files
        if len(chosen) != 1:
            kinds = [kind for kind, suffixes in PREFER.items() if any(p.suffix.lower() in suffixes for p in files)]
            twice = sum(len(f) > 1 for f in shots.values())
            raise InputError(
                f"{folder} holds {twice} pictures twice, such as {' and '.join(p.name for p in files)}, but one file "
                f"of each is needed; choose with {' or '.join(f'--prefer {k}' for k in kinds)}, or move the others "
                "elsewhere."
            )
        kept += chosen
    return kept


def white_boards(folder: Path, names: Sequence[str]) -> list[Path]:
    """The folder's picture of a white board for each of the pictures `names`: of the same names, or in their order."""
    found = find_pictures(folder)
    by_name = {path.stem: path for path in found}
    if all(Path(name).stem in by_name for name in names):
        return [by_name[Path(name).stem] for name in names]
    if len(found) != len(names):
        raise InputError(
            f"--flat {folder} has {len(found)} pictures but one of a white board for each of {len(names)} lights is "
            "needed, of the photographs' names or in their order; add or remove some."
        )
    return found


def pages(pictures: Sequence[Path]) -> list[Picture]:
    """The pictures, each page of a TIFF stack as one; files that can't be read are refused when they are used."""
    found: list[Picture] = []
    for path in pictures:
        try:
            n = pages_of(path) if path.suffix.lower() in PREFER["tiff"] else 1
        except InputError:
            n = 1
        found += [path] if n == 1 else [PicturePart(path, page) for page in range(n)]
    return found


def no_pictures(folder: Path) -> InputError:
    """What to say of a folder in which none was found: folders in it that hold some, or files that are not read."""
    inside = sorted(folder.iterdir()) if folder.is_dir() else []
    below = list(dict.fromkeys(p.parent.name for p in pictures_below(folder)))
    unread = [p.name for p in inside if p.suffix.lower() in UNREAD]
    if below:
        some = a_few(below, 8)
        return InputError(
            f"{folder} holds no pictures, but folders in it do: {some}; give one of them, such as {folder / below[0]}, "
            f"or all of them to `photonormal batch '{folder}/*'`."
        )
    if unread:
        return InputError(
            f"{folder} holds no pictures that can be read, but {len(unread)} such as {unread[0]}; convert them to PNG "
            "or TIFF."
        )
    return InputError(f"{folder} holds no pictures; give a folder with PNG, TIFF, JPEG, EXR, TGA, NPY or RAW files.")


def counts_differ(name: str, pictures: Sequence[Picture], count: int, source: str) -> InputError:
    """What to say where a capture has more or fewer pictures than a source has lights: which pictures look odd."""
    n, names = len(pictures), [picture_name(p) for p in pictures]
    odd = _named_unlike_the_others(names)
    stacks = sorted({p.path.name for p in pictures if isinstance(p, PicturePart) and p.page is not None})
    if odd:
        some = a_few(odd, 5)
        hint = (
            f"{some} {'is' if len(odd) == 1 else 'are'} named unlike the others: name such pictures with --dark, "
            "--flat or --mask, move them elsewhere, or leave them out with --images"
        )
    elif n < count and (unread := _unread(pictures)):
        hint = f"{a_few(unread, 5)} beside them can't be read: convert such pictures to PNG or TIFF"
    elif 0 < len(gaps := _gaps(pictures)) <= count - n:
        some = a_few(gaps, 5)
        hint = (
            f"between {names[0]} and {names[-1]} {some} {'is' if len(gaps) == 1 else 'are'} missing: restore it, or "
            "give with --lights a file that has one for each picture, or names the pictures"
        )
    elif 3 * n == count:
        hint = "if each photograph shows three lights, one in red, one in green and one in blue, add --rgb-lights"
    else:
        they = f"they are {names[0]} to {names[-1]}{f', pages of {stacks[0]}' if stacks else ''}"
        if n > count:
            hint = f"{they}; choose those that belong to the lights with --images, or give lights for all with --lights"
        else:
            hint = (
                f"{they}; pictures are missing, or the lights are those of another capture: give with --lights a file "
                "that has one for each picture, or names the pictures"
            )
    return InputError(f"{name} has {n} pictures but {count} light directions{source}; {hint}.")


def _unread(pictures: Sequence[Picture]) -> list[str]:
    """Pictures of kinds that are not read, of other shots, beside these."""
    files = [path for picture in pictures for path in files_of(picture)]
    shots = {path.stem.casefold() for path in files}
    beside = (p for folder in {path.parent for path in files} for p in folder.iterdir())
    found = {p.name for p in beside if p.suffix.lower() in UNREAD and p.stem.casefold() not in shots}
    return sorted(found, key=natural)


def _gaps(pictures: Sequence[Picture]) -> list[str]:
    """Names that are missing among files that are called alike but for one number, and lie nowhere beside them."""
    if not all(isinstance(p, Path) for p in pictures):
        return []
    folder, parts = files_of(pictures[0])[0].parent, [re.split(r"([0-9]+)", picture_name(p)) for p in pictures]
    if len({len(part) for part in parts}) > 1:
        return []
    vary = [k for k, tokens in enumerate(zip(*parts, strict=True)) if len(set(tokens)) > 1]
    if len(vary) != 1 or vary[0] % 2 == 0:
        return []
    first, at = parts[0], vary[0]
    there, width = {int(part[at]) for part in parts}, min(len(part[at]) for part in parts)
    if max(there) - min(there) >= 2 * len(there):
        return []
    absent = (f"{k:0{width}d}" for k in range(min(there), max(there)) if k not in there)
    named = ["".join([*first[:at], number, *first[at + 1 :]]) for number in absent]
    return [name for name in named if not os.path.lexists(folder / name)]


def _named_unlike_the_others(names: Sequence[str]) -> list[str]:
    """Names that differ from most by more than a number."""
    patterns = [re.sub(r"[0-9]+", "0", stem(name).casefold()) for name in names]
    usual, count = Counter(patterns).most_common(1)[0]
    return [n for n, p in zip(names, patterns, strict=True) if p != usual] if 2 * count > len(names) else []


def refuse_repeated(pictures: Sequence[Picture]) -> None:
    """Raise where two pictures are one file, or one part of it: a photograph has one light."""
    seen: dict[tuple, Path] = {}
    for picture, path in ((p, path) for p in pictures for path in files_of(p)):
        status = os.stat(path)
        part = (picture.page, picture.channel) if isinstance(picture, PicturePart) else ()
        first = seen.setdefault((status.st_dev, status.st_ino, *part), path)
        if first is not path:
            raise InputError(
                f"{first.name} is named {'twice' if first == path else f'again as {path.name}'} but a photograph has "
                "one light; correct the list that names it or choose others with --images."
            )


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


def natural(name: str) -> tuple[list[tuple[bool, int, str]], str]:
    """Sorting key of names that puts image 10 after image 9, and numbers before words, whatever letters' case."""
    tokens = [t for t in re.split(r"([0-9]+)", name.lower()) if t]
    return [(False, int(t), "") if t[0] in "0123456789" else (True, 0, t) for t in tokens], name


def find_mask(folder: Path) -> Path | None:
    """The folder's mask picture: `mask.*`, or a name that ends in `.mask` or `_mask`."""
    masks = [p for p in picture_files(folder) if re.search(r"(^|[._-])mask$", p.stem, re.IGNORECASE)]
    if len(masks) > 1:
        raise InputError(
            f"{folder} has {len(masks)} masks ({', '.join(p.name for p in masks)}); choose one with --mask."
        )
    return masks[0] if masks else None


def picture_files(folder: Path) -> list[Path]:
    """Every file of a folder that is a picture, whatever it shows."""
    return [
        p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith(".") and not p.is_dir()
    ]


def pictures_below(folder: Path) -> list[Path]:
    """Every file that is a picture in the folders of a folder."""
    inside = sorted(folder.iterdir()) if folder.is_dir() else []
    return [file for p in inside if p.is_dir() and os.access(p, os.R_OK | os.X_OK) for file in picture_files(p)]


def evenly(items: Sequence[T], limit: int) -> list[T]:
    """At most `limit` of the items, evenly spaced, the first and the last among them."""
    if not items:
        return []
    return [items[i] for i in np.unique(np.linspace(0, len(items) - 1, min(limit, len(items))).round().astype(int))]
