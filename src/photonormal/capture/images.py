"""Picture files -> linear radiance, keeping every bit: 8 and 16-bit PNG and JPEG, TIFF, EXR, NPY and camera RAW."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photonormal.types import Image, InputError

OPENCV = {".png", ".jpg", ".jpeg", ".bmp"}
TIFF = {".tif", ".tiff"}
RAW = {".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef"}
SUFFIXES = OPENCV | TIFF | RAW | {".exr", ".npy"}

KEEP_BYTES = 2**31  # decoded pictures are kept up to this size, and decoded again beyond it
MARGIN = 8  # pixels kept around the mask's bounding box


def decode(path: Path) -> np.ndarray:
    """The samples of a picture as the file stores them: (h, w, 1 or 3), RGB; uint8, uint16 or float32.

    Raises
    ------
    InputError
        If the file is missing, truncated, not a picture, or holds another kind of number.
    """
    try:
        picture = _READERS[path.suffix.lower()](path)
    except KeyError:
        raise InputError(
            f"{path} is a {path.suffix or 'nameless'} file but a picture is needed; use PNG, TIFF, JPEG, EXR, NPY or RAW."
        ) from None
    except FileNotFoundError:
        raise InputError(f"picture {path} is missing; restore it or leave it out with --images.") from None
    except InputError:
        raise
    except Exception as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"picture {path} can't be read ({reason}); export it again.") from None
    return _checked(picture, path)


def _checked(picture: np.ndarray, path: Path) -> np.ndarray:
    if picture.ndim == 2:
        picture = picture[..., None]
    if picture.ndim != 3 or picture.shape[2] not in (1, 2, 3, 4) or 0 in picture.shape:
        raise InputError(f"picture {path} is {picture.shape} but (height, width, 1 or 3 channels) is needed.")
    picture = picture[..., : 1 if picture.shape[2] <= 2 else 3]  # an alpha channel carries no light
    if picture.dtype in (np.uint8, np.uint16):
        return picture
    if picture.dtype == bool:
        return picture.astype(np.uint8) * np.uint8(255)
    if picture.dtype.kind == "f":
        if not np.isfinite(picture).all():
            raise InputError(f"picture {path} holds NaN or infinite samples; export it again without them.")
        return picture.astype(np.float32, copy=False)
    raise InputError(f"picture {path} holds {picture.dtype} but 8 or 16-bit integers or floats are needed; convert it.")


def _opencv(path: Path) -> np.ndarray:
    import cv2

    data = path.read_bytes()
    end = {".png": b"IEND", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}.get(path.suffix.lower(), b"")
    if end not in data[-4096:]:
        raise InputError(f"picture {path} is truncated ({len(data)} bytes, no end mark); copy or export it again.")
    # OpenCV's own reader can't open every file name on every system, its decoder can
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise InputError(f"picture {path} can't be decoded ({len(data)} bytes); copy or export it again.")
    return _rgb(picture)


def _rgb(bgr: np.ndarray) -> np.ndarray:
    return bgr if bgr.ndim == 2 or bgr.shape[2] < 3 else bgr[..., 2::-1]


def _tiff(path: Path) -> np.ndarray:
    import tifffile

    with tifffile.TiffFile(path) as tiff:
        series = tiff.series[0]
        try:
            picture = series.asarray()
        except ValueError:  # a compression that tifffile leaves to another package
            import cv2

            picture = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
            if picture is None:
                raise
            return _rgb(picture)
        return np.moveaxis(picture, 0, -1) if series.axes in ("SYX", "CYX") else picture


def _exr(path: Path) -> np.ndarray:
    import OpenEXR

    with OpenEXR.File(str(path)) as exr:
        channels = exr.channels()
        for name in ("RGB", "RGBA", "Y"):
            if name in channels:
                return np.asarray(channels[name].pixels)
        if {"R", "G", "B"} <= set(channels):
            return np.stack([channels[c].pixels for c in "RGB"], axis=-1)
    raise InputError(f"picture {path} has channels {', '.join(channels)} but R, G, B or Y is needed; export it again.")


def _npy(path: Path) -> np.ndarray:
    return np.load(path, allow_pickle=False)


def _raw(path: Path) -> np.ndarray:
    try:
        import rawpy
    except ImportError:
        raise InputError(
            f"{path} is a camera RAW file but rawpy is not installed; pip install 'photonormal[raw]'."
        ) from None
    with rawpy.imread(str(path)) as raw:
        return raw.postprocess(
            gamma=(1, 1), no_auto_bright=True, output_bps=16, user_wb=[1, 1, 1, 1], output_color=rawpy.ColorSpace.raw
        )


_READERS = {
    **dict.fromkeys(OPENCV, _opencv),
    **dict.fromkeys(TIFF, _tiff),
    **dict.fromkeys(RAW, _raw),
    ".exr": _exr,
    ".npy": _npy,
}


def full_scale(samples: np.ndarray) -> float:
    """The value that stands for 1: 255, 65535, or 1 where samples are floats."""
    return float(np.iinfo(samples.dtype).max) if samples.dtype.kind == "u" else 1.0


def srgb_to_linear(x: np.ndarray) -> np.ndarray:
    """Linear radiance in [0, 1] from sRGB-encoded values in [0, 1] (IEC 61966-2-1)."""
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4).astype(np.float32)


def read_mask(path: Path) -> np.ndarray:
    """True where the picture is brighter than half of its own maximum: (h, w) bool."""
    picture = decode(path).max(-1)
    return picture > 0.5 * max(picture.max(), 1e-6)


class ImageFiles:
    """`n` picture files of one size as a sequence of linear radiance (h, w, c) float32 (`photonormal.types.Images`).

    Decodes a file when it is asked for. The mask's bounding box with a margin is kept as the file stores it, so that a
    second pass costs no decoding, as long as all boxes fit KEEP_BYTES; outside the box images are zero.

    Parameters
    ----------
    paths : the files
    mask : (h, w) bool, or None: the whole frame is on the object
    intensities : (n, 1) or (n, 3) by which radiance is divided
    srgb : True where the files are sRGB-encoded and have to be linearised
    """

    def __init__(self, paths: list[Path], mask: np.ndarray | None, intensities: np.ndarray, srgb: bool = False):
        first = decode(paths[0])
        self.paths = paths
        self.shape = (len(paths), *first.shape)
        if first.shape[2] == 1:  # colour intensities of a grey picture
            intensities = intensities.mean(1, keepdims=True)
        self.intensities = np.broadcast_to(intensities, (len(paths), first.shape[2])).astype(np.float32)
        self.srgb = srgb and first.dtype.kind == "u"
        self.dtype = first.dtype
        h, w = first.shape[:2]
        self.box = (slice(0, h), slice(0, w)) if mask is None or mask.shape != (h, w) else bounding_box(mask, MARGIN)
        self._kept: list[np.ndarray | None] = [None] * len(paths)
        self.keeps = first[self.box].nbytes * len(paths) <= KEEP_BYTES
        if self.keeps:
            self._kept[0] = np.ascontiguousarray(first[self.box])

    @property
    def saturation(self) -> np.ndarray | None:
        """(n, c) radiance of a saturated sample; None for float files, which need not saturate."""
        return (1 / self.intensities) if self.dtype.kind == "u" else None

    def _samples(self, j: int) -> np.ndarray:
        kept = self._kept[j]
        if kept is not None:
            return kept
        samples = decode(self.paths[j])
        if samples.shape != self.shape[1:] or samples.dtype != self.dtype:
            raise InputError(
                f"picture {self.paths[j]} is {samples.shape} {samples.dtype} but {self.paths[0].name} is "
                f"{self.shape[1:]} {self.dtype}; all pictures of a capture need one size and one kind of sample."
            )
        crop = samples[self.box]
        if self.keeps:
            crop = self._kept[j] = np.ascontiguousarray(crop)
        return crop

    def __getitem__(self, j: int) -> Image:
        samples = self._samples(j)
        image = np.zeros(self.shape[1:], np.float32)
        scale = np.float32(1 / full_scale(samples))
        if self.srgb:
            samples = srgb_to_linear(samples * scale)
            scale = np.float32(1)
        np.multiply(samples, scale / self.intensities[j], out=image[self.box])
        return image

    def __len__(self) -> int:
        return self.shape[0]


def bounding_box(mask: np.ndarray, margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns of the smallest box around the mask, grown by `margin` pixels within the frame."""
    spans = []
    for axis in (1, 0):
        inside = np.flatnonzero(mask.any(axis))
        if not inside.size:
            return slice(0, mask.shape[0]), slice(0, mask.shape[1])
        spans.append(slice(max(0, int(inside[0]) - margin), int(inside[-1]) + 1 + margin))
    return spans[0], spans[1]
