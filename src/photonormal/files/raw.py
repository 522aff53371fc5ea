"""Cameras' RAW files, by rawpy: linear, without white balance or curve, in the sensor's own frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from photonormal.files.chatter import heard
from photonormal.files.header import Header
from photonormal.types import InputError


def header(file: BinaryIO, path: Path) -> Header:
    """Size of the developed picture."""
    rawpy = _rawpy(path)
    sizes, _ = heard(lambda: _sizes(rawpy, file))
    if isinstance(sizes, Exception):
        raise sizes
    return Header(sizes.height, sizes.width, sizes.raw_height * sizes.raw_width * 3 * 2)


def read(file: BinaryIO, path: Path) -> np.ndarray:
    """Samples (h, w, 3), 16-bit."""
    rawpy = _rawpy(path)
    with rawpy.imread(file) as raw:
        return raw.postprocess(
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0,  # else the scale would change with each picture's brightest sample
            output_bps=16,
            user_wb=[1, 1, 1, 1],
            user_flip=0,
            output_color=rawpy.ColorSpace.raw,
        )


def _sizes(rawpy: Any, file: BinaryIO) -> Any:
    file.seek(0)
    with rawpy.imread(file) as raw:
        return raw.sizes


def _rawpy(path: Path) -> Any:
    try:
        import rawpy
    except ImportError:
        raise InputError(
            f"{path} is a camera RAW file but rawpy is not installed; pip install 'photonormal[raw]'."
        ) from None
    return rawpy
