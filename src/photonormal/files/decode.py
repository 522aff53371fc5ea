"""One picture file -> its samples, keeping every bit: PNG, JPEG, BMP, TGA, TIFF, EXR, NPY and camera RAW.

A kind of file is one module with `header(file) -> Header` and `read(file, path) -> samples`, and one line in KINDS.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from photonormal.files import memory
from photonormal.files.chatter import heard
from photonormal.files.header import Header, damaged
from photonormal.files.opening import open_file, reason_of, size_of
from photonormal.types import UNITS, InputError, in_pixels

RAW = {
    *(".dng", ".cr2", ".cr3", ".nef", ".nrw", ".arw", ".raf", ".orf", ".rw2", ".rwl", ".pef", ".srw"),
    *(".iiq", ".3fr", ".fff"),
}
JPEG = {".jpg", ".jpeg", ".jpe", ".jfif"}
KINDS = {  # suffix -> module, imported when it is needed
    **dict.fromkeys(sorted({*JPEG, ".png", ".bmp"}), "photonormal.files.plain"),
    **dict.fromkeys((".tif", ".tiff"), "photonormal.files.tiff"),
    ".tga": "photonormal.files.tga",
    ".exr": "photonormal.files.exr",
    ".npy": "photonormal.files.npy",
    **dict.fromkeys(sorted(RAW), "photonormal.files.raw"),
}
SUFFIXES = set(KINDS)

DENSEST = 2000  # samples' bytes for each byte of a file, at most; compression of photographs reaches half of that
SMALL = 2**26  # bytes of samples that no density makes suspect
FAULT = re.compile(r"error|corrupt|premature|truncat|exception|unexpected|invalid|_ERR_", re.IGNORECASE)
HARMLESS = re.compile(r"libpng warning|extraneous bytes before marker 0xd9|: Warning, ")  # and the picture is whole


def decode(path: Path, frame: tuple[int, int] | None = None, page: int | None = None) -> np.ndarray:
    """The samples of a picture as the file stores them: (h, w, 1 or 3), RGB; uint8, uint16 or float32.

    Alpha is left out. A camera's note of how it was held (Exif orientation) is ignored: lights are given in the
    sensor's frame, and such notes change between pictures when a camera looks down.

    Parameters
    ----------
    frame : (h, w) that the picture must have, by its header: nothing is decoded otherwise. None: any
    page : which page of a TIFF stack, 0-based; None: the file must have one

    Raises
    ------
    InputError
        If the file is missing, truncated, not a picture, of another size, larger than the memory allows, or holds
        another kind of number; where its decoder calls it corrupt.
    """
    samples = decode_all(path, frame, page)
    return samples[..., : 1 if samples.shape[2] <= 2 else 3]


def decode_all(
    path: Path, frame: tuple[int, int] | None = None, page: int | None = None, finite: bool = True
) -> np.ndarray:
    """As `decode`, with alpha where the file has it: (h, w, 1 to 4); any float unless `finite`."""
    kind = _kind(path)
    which = {} if page is None else {"page": page}
    with _refusals(path), open_file(path) as file:
        header = _header(kind, file, path, which)
        _same_frame(header, frame, path)
        result, printed = heard(lambda: kind.read(_at_its_start(file), path, **which))
        word = _word(printed)
        if word:
            raise damaged(path, word)
        if isinstance(result, Exception):
            raise result
        return _checked(result, path, finite)


def frame_of(path: Path, frame: tuple[int, int] | None = None, page: int | None = None) -> tuple[int, int]:
    """Height and width of a picture by its header, which must be `frame` where given; InputError as for `decode`."""
    kind = _kind(path)
    with _refusals(path), open_file(path) as file:
        header = _header(kind, file, path, {} if page is None else {"page": page})
    _same_frame(header, frame, path)
    return header.height, header.width


def pages_of(path: Path) -> int:
    """How many pictures a file holds: pages of a TIFF stack, 1 of any other kind."""
    kind = _kind(path)
    if not hasattr(kind, "pages"):
        return 1
    with _refusals(path), open_file(path) as file:
        memory.check(size_of(file), f"picture {path}")
        return kind.pages(file, path)


def _same_frame(header: Header, frame: tuple[int, int] | None, path: Path) -> None:
    came = header.height, header.width
    if frame is not None and came != tuple(frame):
        turned = came == tuple(frame)[::-1]
        remedy = "a program may have turned it: turn it back" if turned else "export it with the same frame"
        raise InputError(
            f"picture {path} has {in_pixels(came)} but {in_pixels(frame)} are needed, as the other pictures of the "
            f"capture have; {remedy}."
        )


def full_scale(samples: np.ndarray) -> float:
    """The value that stands for 1: 255, 65535, or 1 where samples are floats."""
    return float(np.iinfo(samples.dtype).max) if samples.dtype.kind == "u" else 1.0


def _kind(path: Path) -> Any:
    module = KINDS.get(path.suffix.lower())
    if module is None and not path.suffix and not path.is_file():
        raise InputError(
            f"{path} is {'a folder' if path.is_dir() else 'not there'} but a picture is needed; correct it."
        )
    if module is None:
        raise InputError(
            f"{path} is a {path.suffix or 'nameless'} file but a picture is needed; "
            "use PNG, TIFF, JPEG, BMP, TGA, EXR, NPY or RAW."
        )
    return import_module(module)


def _header(kind: Any, file: BinaryIO, path: Path, which: dict[str, int]) -> Header:
    """What a file claims to hold, which the memory allows and the file can hold."""
    size = size_of(file)
    memory.check(size, f"picture {path}")
    header = kind.header(file, path, **which)
    memory.check(header.nbytes, f"picture {path}, {in_pixels((header.height, header.width))},")
    if header.nbytes > max(DENSEST * size, SMALL):
        raise damaged(path, f"claims {header.nbytes} bytes of samples in {size}")
    return header


def _at_its_start(file: BinaryIO) -> BinaryIO:
    file.seek(0)
    return file


def _word(printed: str) -> str:
    """What a decoder said is wrong; empty where nothing is, or it does not matter."""
    lines = [line.strip() for line in printed.splitlines() if FAULT.search(line) and not HARMLESS.search(line)]
    return f"is damaged ({lines[0][:200]})" if lines else ""


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Whatever reading a picture raises becomes an InputError."""
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"picture {path} is missing; restore it or leave it out.") from None
    except OSError as error:
        raise InputError(f"picture {path} can't be read ({error.strerror or error}); check the file.") from None
    except Exception as error:  # decoders raise anything on a damaged file
        raise InputError(f"picture {path} can't be decoded ({reason_of(error)}); copy or export it again.") from None


def _checked(picture: np.ndarray, path: Path, finite: bool) -> np.ndarray:
    if picture.ndim == 2:
        picture = picture[..., None]
    if picture.ndim != 3 or picture.shape[2] not in (1, 2, 3, 4) or 0 in picture.shape:
        raise InputError(
            f"picture {path} is {picture.shape} but (height, width, 1 or 3 channels) is needed; convert it."
        )
    kind = picture.dtype.newbyteorder("=")
    if kind in (np.uint8, np.uint16):
        return picture.astype(kind, copy=False)
    if kind.kind == "b":
        return picture.astype(np.uint8) * np.uint8(255)
    if kind.kind == "f":
        with np.errstate(over="ignore"):
            picture = picture.astype(np.float32, copy=False)
        if finite and not -UNITS[1] <= picture.min() <= picture.max() <= UNITS[1]:  # nor where one is NaN
            raise InputError(
                f"picture {path} holds samples that are NaN, infinite or beyond {UNITS[1]:g}, which is too much for "
                "single precision; export it again without them, or divide all pictures by one number."
            )
        return picture
    raise InputError(f"picture {path} holds {kind} but 8 or 16-bit integers or floats are needed; convert it.")
