"""Films: frames one after the other, as MP4 or GIF."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from photonormal.types import InputError

FORMATS = (".mp4", ".gif")
PER_SECOND = 24


def write(frames: Iterable[UInt8[np.ndarray, "h w 3"]], path: Path) -> None:
    """Write RGB frames with even sides to a file; .mp4 holds VP9, which browsers play, .gif repeats for ever.

    Raises
    ------
    InputError
        If OpenCV has no encoder for it here.
    """
    bgr = (np.ascontiguousarray(frame[..., ::-1]) for frame in frames)
    if path.suffix.lower() == ".gif":
        film = cv2.Animation()
        film.frames = list(bgr)
        film.durations = [round(1000 / PER_SECOND)] * len(film.frames)
        if not cv2.imwriteanimation(str(path), film, [cv2.IMWRITE_GIF_COLORTABLE, 1, cv2.IMWRITE_GIF_DITHER, 1]):
            raise InputError(f"{path.name} can't be written: this OpenCV writes no GIF; choose a name in .mp4.")
        return
    writer = None
    for frame in bgr:
        if writer is None:
            size = frame.shape[1::-1]
            writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"vp09"), PER_SECOND, size)
            if not writer.isOpened():
                raise InputError(f"{path.name} can't be written: this OpenCV writes no VP9; choose a name in .gif.")
        writer.write(frame)
    if writer is not None:
        writer.release()
