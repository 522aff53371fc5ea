"""Films: frames one after the other, as MP4 or GIF."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

import cv2
import numpy as np
from jaxtyping import UInt8

from photonormal.types import InputError

FORMATS = (".mp4", ".gif")
PER_SECOND = 24


def encoded(frames: Iterable[UInt8[np.ndarray, "h w 3"]], suffix: str) -> bytes:
    """A film of RGB frames with even sides; .mp4 holds VP9, which browsers play, .gif repeats for ever.

    It is made in a scratch folder (`TMPDIR`): encoders write files, and don't say where the disk was full.

    Raises
    ------
    InputError
        If OpenCV has no encoder for it here, or the scratch folder has no room for it.
    """
    bgr = (np.ascontiguousarray(frame[..., ::-1]) for frame in frames)
    with TemporaryDirectory(prefix="photonormal-") as scratch:
        path = Path(scratch) / f"film{suffix}"
        whole = _gif(bgr, path) if suffix == ".gif" else _mp4(bgr, path)
        if not whole:
            raise InputError(f"{gettempdir()} has no room for a film; free some, or name another folder by TMPDIR.")
        return path.read_bytes()


def _gif(frames: Iterable[np.ndarray], path: Path) -> bool:
    """Whether all of it is there."""
    film = cv2.Animation()
    film.frames = list(frames)
    film.durations = [round(1000 / PER_SECOND)] * len(film.frames)
    if not cv2.imwriteanimation(str(path), film, [cv2.IMWRITE_GIF_COLORTABLE, 1, cv2.IMWRITE_GIF_DITHER, 1]):
        raise InputError("this OpenCV writes no GIF; choose a name in .mp4.")
    return path.read_bytes()[-1:] == b";"  # its last byte


def _mp4(frames: Iterable[np.ndarray], path: Path) -> bool:
    """Whether all of it is there."""
    writer, count = None, 0
    for frame in frames:
        if writer is None:
            size = frame.shape[1::-1]
            writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"vp09"), PER_SECOND, size)
            if not writer.isOpened():
                raise InputError("this OpenCV writes no VP9; choose a name in .gif.")
        writer.write(frame)
        count += 1
    if writer is not None:
        writer.release()
    return cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_COUNT) == count
