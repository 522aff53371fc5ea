"""One picture file -> its samples, keeping every bit: PNG, JPEG and BMP, TIFF, EXR, NPY and camera RAW."""

from __future__ import annotations

import logging
import struct
import zlib
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from photonormal.types import InputError

PLAIN = {".png", ".jpg", ".jpeg", ".bmp"}
TIFF = {".tif", ".tiff"}
RAW = {".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef"}
SUFFIXES = PLAIN | TIFF | RAW | {".exr", ".npy"}

PNG_START = b"\x89PNG\r\n\x1a\n"
DENSEST = 2000  # samples' bytes for each byte of a TIFF, at most; compression reaches half of that
JPEG_START, JPEG_SCAN, JPEG_END = b"\xff\xd8\xff", 0xDA, b"\xff\xd9"

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # what it has to say arrives as an InputError


def decode(path: Path) -> np.ndarray:
    """The samples of a picture as the file stores them: (h, w, 1 or 3), RGB; uint8, uint16 or float32.

    Alpha is left out. A camera's note of how it was held (Exif orientation) is ignored: lights are given in the
    sensor's frame, and such notes change between pictures when a camera looks down.

    Raises
    ------
    InputError
        If the file is missing, truncated, not a picture, or holds another kind of number.
    """
    samples = decode_all(path)
    return samples[..., : 1 if samples.shape[2] <= 2 else 3]


def decode_all(path: Path) -> np.ndarray:
    """As `decode`, with alpha where the file has it: (h, w, 1 to 4)."""
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise InputError(
            f"{path} is a {path.suffix or 'nameless'} file but a picture is needed; "
            "use PNG, TIFF, JPEG, BMP, EXR, NPY or RAW."
        )
    try:
        return _checked(read(path), path)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"picture {path} is missing; restore it or leave it out.") from None
    except OSError as error:
        raise InputError(f"picture {path} can't be read ({error.strerror or error}); check the file.") from None
    except Exception as error:  # decoders raise anything on a damaged file
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"picture {path} can't be decoded ({reason[:200]}); copy or export it again.") from None


def full_scale(samples: np.ndarray) -> float:
    """The value that stands for 1: 255, 65535, or 1 where samples are floats."""
    return float(np.iinfo(samples.dtype).max) if samples.dtype.kind == "u" else 1.0


def _checked(picture: np.ndarray, path: Path) -> np.ndarray:
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
        if not np.isfinite(picture).all():
            raise InputError(f"picture {path} holds NaN, infinite or huge samples; export it again without them.")
        return picture
    raise InputError(f"picture {path} holds {kind} but 8 or 16-bit integers or floats are needed; convert it.")


def _damaged(path: Path, what: str) -> InputError:
    return InputError(f"picture {path} {what}, but a whole picture is needed; copy or export it again.")


def _plain(path: Path) -> np.ndarray:
    """PNG, JPEG or BMP, by content: names lie. Checked first, since OpenCV fills in what is missing."""
    data = path.read_bytes()
    if data.startswith(PNG_START):
        data = _whole_png(data, path)
    elif data.startswith(JPEG_START):
        _check_jpeg(data, path)
    elif not data.startswith(b"BM"):
        raise _damaged(path, f"is no PNG, JPEG or BMP ({len(data)} bytes)")
    elif int.from_bytes(data[2:6], "little") > len(data):
        raise _damaged(path, f"is truncated ({len(data)} bytes)")
    return _opencv(data, path)


def _opencv(data: bytes, path: Path) -> np.ndarray:
    import cv2

    # OpenCV's own reader can't open every file name on every system, its decoder can
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise _damaged(path, f"can't be decoded ({len(data)} bytes)")
    if picture.ndim == 3 and picture.shape[2] >= 3:
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB if picture.shape[2] == 3 else cv2.COLOR_BGRA2RGBA)
    return picture


def _whole_png(data: bytes, path: Path) -> bytes:
    """The chunks of a PNG that hold samples, their checksums right: colour profiles and remarks don't reach libpng."""
    at, view = len(PNG_START), memoryview(data)
    kept = [view[:at]]
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            break
        critical = kind[0] < ord("a")
        if critical and zlib.crc32(view[at + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            raise _damaged(path, f"is damaged (checksum of the chunk at byte {at})")
        if critical or kind == b"tRNS":
            kept.append(view[at:end])
        if kind == b"IEND":
            return b"".join(kept)
        at = end
    raise _damaged(path, f"is truncated ({len(data)} bytes)")


def _check_jpeg(data: bytes, path: Path) -> None:
    """Raise unless the end mark follows the first scan; thumbnails lie in segments before it and have their own."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        if data[at + 1] == JPEG_SCAN and data.find(JPEG_END, at) > 0:
            return
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise _damaged(path, f"is truncated ({len(data)} bytes)")


def _tiff(path: Path) -> np.ndarray:
    import tifffile

    with tifffile.TiffFile(path) as tiff:
        pages: list[Any] = [p for p in tiff.pages if not getattr(p, "is_reduced", False)]
        if len(pages) != 1:
            raise InputError(f"picture {path} holds {len(pages)} pages but one is needed; export each as its own file.")
        page = pages[0]
        photometric, compression = (getattr(v, "name", str(v)) for v in (page.photometric, page.compression))
        samples = ("MINISWHITE", "MINISBLACK", "RGB", *(["YCBCR"] if compression == "JPEG" else []))  # RGB by decoding
        if page.axes not in ("YX", "YXS", "SYX") or photometric not in samples:
            raise InputError(
                f"picture {path} is {photometric} with axes {page.axes} but grey levels or RGB are needed; convert it."
            )
        size, parts = tiff.filehandle.size, list(zip(page.dataoffsets, page.databytecounts, strict=False))
        if len(parts) != prod(page.chunked) or any(n == 0 or start + n > size for start, n in parts):
            raise _damaged(path, f"is truncated or damaged ({size} bytes)")  # tifffile would put zeros there
        if page.nbytes > DENSEST * size:
            raise _damaged(path, f"claims {page.nbytes} bytes of samples in {size}")
        try:
            picture = page.asarray()
        except (ValueError, ImportError) as error:  # a compression that tifffile leaves to another package
            if isinstance(error, ValueError) and "imagecodecs" not in str(error):
                raise
            if compression not in ("LZW", "JPEG", "DEFLATE", "ADOBE_DEFLATE"):
                raise InputError(
                    f"picture {path} can't be decoded ({error}); pip install imagecodecs or export it uncompressed."
                ) from None
            return _opencv(path.read_bytes(), path)
    if photometric == "MINISWHITE" and picture.dtype.kind in "ub":
        picture = ~picture
    return np.moveaxis(picture, 0, -1) if page.axes == "SYX" else picture


def _exr(path: Path) -> np.ndarray:
    import OpenEXR

    path.open("rb").close()  # OpenEXR does not say why it can't open a file
    with OpenEXR.File(str(path)) as exr:
        if not exr.parts:
            raise _damaged(path, "is truncated or damaged")
        channels = exr.channels()
        for name in ("RGB", "RGBA", "Y"):
            if name in channels:
                return np.asarray(channels[name].pixels)
    raise InputError(f"picture {path} has channels {', '.join(channels)} but R, G, B or Y is needed; export it again.")


def _npy(path: Path) -> np.ndarray:
    with path.open("rb") as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def _raw(path: Path) -> np.ndarray:
    try:
        import rawpy
    except ImportError:
        raise InputError(
            f"{path} is a camera RAW file but rawpy is not installed; pip install 'photonormal[raw]'."
        ) from None
    with path.open("rb") as file, rawpy.imread(file) as raw:
        return raw.postprocess(
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0,  # else the scale would change with each picture's brightest sample
            output_bps=16,
            user_wb=[1, 1, 1, 1],
            user_flip=0,
            output_color=rawpy.ColorSpace.raw,
        )


_READERS = {
    **dict.fromkeys(PLAIN, _plain),
    **dict.fromkeys(TIFF, _tiff),
    **dict.fromkeys(RAW, _raw),
    ".exr": _exr,
    ".npy": _npy,
}
