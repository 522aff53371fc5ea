"""Picture files -> linear radiance divided by the intensity of the light."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.capture.encoding import LINEAR, Encoding
from photonormal.capture.store import Framed
from photonormal.files.decode import decode, decode_all, frame_of, full_scale
from photonormal.masked import box_of
from photonormal.types import Image, InputError, in_pixels


@dataclass(frozen=True)
class PicturePart:
    """A part of a file that is a picture by itself: a page of a stack, or one channel under a light of its own.

    Parameters
    ----------
    page : 0-based; None: the file has one
    channel : 0, 1 or 2; None: all
    """

    path: Path
    page: int | None = None
    channel: int | None = None

    @property
    def name(self) -> str:
        """What reports call it, pages counted from 1."""
        page = "" if self.page is None else f"[{self.page + 1}]"
        return self.path.name + page + ("" if self.channel is None else f"[{COLOURS[self.channel]}]")


COLOURS = ("red", "green", "blue")
Picture = Path | PicturePart | tuple[Path, ...]  # a file, a part of one, or several whose sum is the picture

ROWS = 8  # every so many rows of a picture show whether another may be equal
MARGIN = 8  # pixels kept around the mask's bounding box


def files_of(picture: Picture) -> tuple[Path, ...]:
    """The files of a picture."""
    if isinstance(picture, PicturePart):
        return (picture.path,)
    return picture if isinstance(picture, tuple) else (picture,)


def picture_name(picture: Picture) -> str:
    """What reports call a picture: its file's name, and which part of it."""
    return picture.name if isinstance(picture, PicturePart) else files_of(picture)[0].name


def picture_size(picture: Picture, frame: tuple[int, int] | None = None) -> tuple[int, int]:
    """Height and width of a picture by its header, which must be `frame` where given."""
    return frame_of(files_of(picture)[0], frame, picture.page if isinstance(picture, PicturePart) else None)


def planes(picture: Picture) -> list[PicturePart]:
    """The three channels of a photograph as pictures."""
    file, page = (picture.path, picture.page) if isinstance(picture, PicturePart) else (files_of(picture)[0], None)
    return [PicturePart(file, page, channel) for channel in range(3)]


def read_mask(path: Path, frame: tuple[int, int] | None = None) -> np.ndarray:
    """True where the picture, laid on black where it is transparent, is brighter than half of its maximum: (h, w).

    Of a thing that was cut out of a photograph it is true where that is not transparent, however dark the thing is.
    Its size must be `frame`, where that is given.
    """
    samples = decode_all(path, frame)
    if samples.shape[2] in (2, 4):
        colour, alpha = samples[..., :-1].max(-1), samples[..., -1]
        opaque = alpha > 0.5 * float(alpha.max())
        if not opaque.all() and not _drawn(colour[opaque]):
            return opaque
        level = colour.astype(np.float32) * alpha.astype(np.float32)
    else:
        level = samples.max(-1)
    return level > 0.5 * float(level.max())


def _drawn(colour: np.ndarray) -> bool:
    """Whether these are the black and the white of a mask, and not of a photograph."""
    dark, bright = (colour <= 0.1 * float(colour.max(initial=0))), (colour >= 0.9 * float(colour.max(initial=0)))
    return bool((dark & ~bright).any() and bright.any() and (dark | bright).mean() > 0.95)


class ImageFiles:
    """`n` pictures of one size as a sequence of linear radiance (h, w, c) float32 (`photonormal.types.Images`).

    Decodes each file once, when it is asked for. The mask's bounding box with a margin is kept as the file stores it,
    in memory or in a scratch file (`capture.store`); outside the box images are zero. Threads may share it.

    Parameters
    ----------
    pictures : the files
    mask : (h, w) bool, or None: the whole frame is on the object
    intensities : (n, 1) or (n, 3) by which radiance is divided
    encodings : what makes the samples of each file linear (`photonormal.capture.encoding`); None: they are. Floats
        always are
    distinct : True where each picture has a light of its own: equal ones are refused
    margin : pixels kept around the mask's box
    """

    def __init__(
        self,
        pictures: Sequence[Picture],
        mask: np.ndarray | None,
        intensities: np.ndarray,
        encodings: Sequence[Encoding] | None = None,
        distinct: bool = False,
        margin: int = MARGIN,
    ):
        self.frame = picture_size(pictures[0])
        for other in pictures[1:2]:  # of two that differ in size neither is decoded
            picture_size(other, self.frame)
        first = _decode(pictures[0], self.frame)
        n, (h, w, c) = len(pictures), first.shape
        self.pictures = pictures
        self.shape: tuple[int, int, int, int] = (n, h, w, c)
        self.dtype = first.dtype
        if c == 1:  # colour intensities of a grey picture
            intensities = intensities.mean(1, keepdims=True)
        self.intensities = np.broadcast_to(intensities, (n, c)).astype(np.float32)
        scale = full_scale(first)
        self.scale = np.float32(1 / scale)
        if encodings is None or self.dtype.kind != "u":
            encodings = [LINEAR if self.dtype.kind == "u" else Encoding(by="floats are")] * n
        self.encodings = encodings
        self.box = (slice(0, h), slice(0, w)) if mask is None or mask.shape != (h, w) else box_of(mask, margin)
        self._first: np.ndarray | None = first[self.box]
        self._kept = Framed(self.shape, self.box, self.dtype, self._samples)
        self._seen: dict[int, int] = {}  # digest of some rows -> the picture that has them
        self.distinct = distinct
        self._refuse_equal(0, first[self.box])

    @property
    def saturation(self) -> np.ndarray | None:
        """(n, c) radiance of a saturated sample; None for float files, which need not saturate."""
        return (1 / self.intensities) if self.dtype.kind == "u" else None

    def _samples(self, j: int) -> np.ndarray:
        """What the file of picture `j` stores inside the box."""
        if j == 0 and self._first is not None:
            first, self._first = self._first, None
            return first
        samples = _decode(self.pictures[j], self.frame)
        if samples.shape != self.shape[1:] or samples.dtype != self.dtype:
            raise InputError(
                f"picture {files_of(self.pictures[j])[0]} has {_described(samples.shape, samples.dtype)} but "
                f"{picture_name(self.pictures[0])} has {_described(self.shape[1:], self.dtype)}; all pictures of a "
                "capture need the same, so export them alike, or choose those that are with --images."
            )
        self._refuse_equal(j, samples[self.box])
        return samples[self.box]

    def _refuse_equal(self, j: int, crop: np.ndarray) -> None:
        """Raise where another picture has the very samples of picture `j`: it was taken once, whatever its names.

        Black ones may agree: their lights did not reach the object.
        """
        other = self._seen.setdefault(zlib.crc32(crop[::ROWS].tobytes()), j)
        if not self.distinct or other == j or not crop.any():
            return
        if not np.array_equal(crop, _decode(self.pictures[other], self.frame)[self.box]):
            return
        if self.dtype.kind == "u" and crop.min() == full_scale(crop):
            raise InputError(
                f"{picture_name(self.pictures[other])} and {picture_name(self.pictures[j])} are white all over the "
                "object; expose less, and photograph it again."
            )
        alike = [picture_name(p) for p in self.pictures if np.array_equal(crop, _decode(p, self.frame)[self.box])]
        raise InputError(
            f"{len(alike)} photographs ({', '.join(alike)}) are equal in every sample but each needs a light of its "
            "own; leave all but one of them out, or copy them from the camera again."
        )

    def __getitem__(self, j: int) -> Image:
        return self.window(j, slice(None), slice(None))

    def own(self, frame: np.ndarray, j: int) -> np.ndarray:
        """What a frame (h, w, c) of the whole camera holds for picture `j`, which may be one channel of it."""
        picture = self.pictures[j]
        channel = picture.channel if isinstance(picture, PicturePart) else None
        return frame if channel is None or frame.shape[2] == 1 else frame[..., channel, None]

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of picture `j`."""
        return self._linear(j, *self._kept.window(j, rows, columns))

    def decoded(self, j: int) -> Image:
        """Picture `j`, decoded anew and not kept."""
        return self._linear(j, self.shape[1:3], self.box, self._samples(j))

    def _linear(self, j: int, size: tuple[int, ...], at: tuple[slice, slice], samples: np.ndarray) -> Image:
        """Linear radiance of a part of a picture whose samples lie at `at`; zero around them."""
        (h, w), c, scale = size, self.shape[3], self.scale
        if self.encodings[j].curves:
            picture = self.pictures[j]
            channel = picture.channel if isinstance(picture, PicturePart) else None
            samples, scale = self.encodings[j].linear(samples, channel), np.float32(1)
        image = np.zeros((h, w * c), np.float32)  # whole rows: numpy is slow where it scales three channels at a time
        rows, columns = at
        out = image[rows, columns.start * c : columns.stop * c]
        np.multiply(samples.reshape(out.shape), np.tile(scale / self.intensities[j], out.shape[1] // c), out=out)
        return image.reshape(h, w, c)

    def __len__(self) -> int:
        return self.shape[0]


def _decode(picture: Picture, frame: tuple[int, int]) -> np.ndarray:
    """Samples of a file or a part of it; of several files, their sum as a fraction of full scale, float32."""
    if isinstance(picture, PicturePart):
        samples = decode(picture.path, frame, picture.page)
        if picture.channel is not None and samples.shape[2] != 3:
            raise InputError(
                f"picture {picture.path} has {samples.shape[2]} channel but red, green and blue are needed, a light "
                "each; leave --rgb-lights out."
            )
        return samples if picture.channel is None else samples[..., picture.channel, None]
    files = [decode(path, frame) for path in files_of(picture)]
    if len(files) == 1:
        return files[0]
    if len({f.shape for f in files}) != 1:
        names = ", ".join(f"{path} {f.shape}" for path, f in zip(files_of(picture), files, strict=True))
        raise InputError(f"the parts of a picture differ in size ({names}) but are added; export them again.")
    return np.sum([f / np.float32(full_scale(f)) for f in files], axis=0)


def _described(shape: tuple[int, ...], kind: np.dtype) -> str:
    """What the samples of a picture are, in words."""
    samples = f"{8 * kind.itemsize}-bit {'samples' if kind.kind == 'u' else 'floating-point samples'}"
    return f"{in_pixels(shape)} of {'one channel' if shape[2] == 1 else f'{shape[2]} channels'}, {samples}"
