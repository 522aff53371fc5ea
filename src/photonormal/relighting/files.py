"""Fits as files: .ptm (Hewlett-Packard's format 1.2) and .rti with hemispherical harmonics."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float

from photonormal.files.rows import Rows
from photonormal.progress import progress
from photonormal.relighting import FORMATS
from photonormal.relighting.codes import Codes
from photonormal.relighting.fit import RelightingFit, pieces
from photonormal.types import Capture, InputError

LARGEST = 2**31 - 1  # bytes: many viewers count them in 32 bits


def write(capture: Capture, kind: str, path: Path) -> None:
    """Fit the photographs, and write the fit of the mask's box to a file; pixels outside the mask are black.

    The photographs are gone through once, some rows at a time; coefficients lie on disk until their ranges are known.

    Parameters
    ----------
    kind : a key of FORMATS whose ending is a file's
    path : the file, which is made or emptied

    Raises
    ------
    InputError
        If the capture's lights are unknown or too few, or the file would be larger than viewers can read.
    """
    fit = RelightingFit(capture, FORMATS[kind].basis)
    h, w = fit.size
    k = fit.terms
    lrgb = kind == "ptm"
    size = h * w * (k + 3 if lrgb else 3 * k)
    if size > LARGEST:
        raise InputError(
            f"a {kind} file of {w} x {h} pixels would have {size} bytes but viewers read at most {LARGEST}; measure a "
            "part of the photographs with --crop, or reduce them with --scale."
        )
    B = fit.basis(capture.known_lights())
    store = partial(_lrgb, gram=(B.T @ B).astype(np.float32)) if lrgb else _ptm if kind == "ptm-rgb" else _rti
    with fit.layers() as layers, path.open("wb") as file:
        store(file, layers)


def _stored(layers: list[Rows]) -> Iterator[tuple[slice, np.ndarray]]:
    """Some rows after the other, while progress is reported."""
    with progress("file", layers[0].shape[0]) as advance:
        for rows, C in pieces(layers):
            yield rows, C
            advance(rows.stop - rows.start)


def _ptm(file: BinaryIO, layers: list[Rows]) -> None:
    """A block for each of red, green and blue."""
    h, w, _ = layers[0].shape
    codes = Codes.of(np.moveaxis(C, 0, -1) for _, C in pieces(layers))
    start = _begun(file, "PTM_FORMAT_RGB", (h, w), codes)
    for rows, C in _stored(layers):
        for channel in range(3):
            file.seek(start + (channel * h + h - rows.stop) * w * 6)
            file.write(codes(np.moveaxis(C[..., channel], 0, -1))[::-1].tobytes())


def _lrgb(file: BinaryIO, layers: list[Rows], gram: Float[np.ndarray, "k k"]) -> None:
    """A block of one luminance's coefficients, and one of colours of at most 1 that multiply it: what is nearest to
    red, green and blue over all lights, of which `gram` are the basis' products."""
    h, w, _ = layers[0].shape

    def parted(C: np.ndarray) -> tuple[Float[np.ndarray, "rows w k"], Float[np.ndarray, "rows w 3"]]:
        Y = C @ np.full(3, 1 / 3, np.float32)  # (k, rows, w)
        GY = np.tensordot(gram, Y, 1)
        colour = np.stack([(C[..., channel] * GY).sum(0) for channel in range(3)])  # (3, rows, w)
        colour /= np.maximum((Y * GY).sum(0), 1e-9)
        most = np.maximum(colour.max(0), 1e-9)
        return np.moveaxis(Y * most, 0, -1), np.moveaxis((colour / most).clip(0), 0, -1)

    codes = Codes.of(parted(C)[0] for _, C in pieces(layers))
    start = _begun(file, "PTM_FORMAT_LRGB", (h, w), codes)
    for rows, C in _stored(layers):
        Y, colour = parted(C)
        file.seek(start + (h - rows.stop) * w * 6)
        file.write(codes(Y)[::-1].tobytes())
        file.seek(start + h * w * 6 + (h - rows.stop) * w * 3)
        file.write(np.rint(255 * colour).astype(np.uint8)[::-1].tobytes())


def _begun(file: BinaryIO, form: str, size: tuple[int, int], codes: Codes) -> int:
    """A .ptm up to its blocks, whose rows go from the bottom to the top, and where they start.

    Coefficients are (code - bias) scale in 255ths of white.
    """
    h, w = size
    numbers = " ".join(f"{255 * s:.9g}" for s in codes.step), " ".join(f"{int(z)}" for z in codes.zero)
    lines = ["PTM_1.2", form, str(w), str(h), *numbers]
    return file.write("".join(f"{line}\n" for line in lines).encode())


def _rti(file: BinaryIO, layers: list[Rows]) -> None:
    """Coefficients are code / 255 scale + bias, white is 1; rows from the top, in each pixel red, green, blue."""
    h, w, _ = layers[0].shape
    k = len(layers)
    codes = Codes.of(np.moveaxis(C, 0, -1) for _, C in pieces(layers))
    file.write(f"#HSH1.2\r\n3\r\n{w} {h} 3\r\n{k} 2 1\r\n".encode())
    file.write(np.concatenate([255 * codes.step, -codes.zero * codes.step]).astype("<f4").tobytes())
    for _, C in _stored(layers):
        file.write(codes(np.moveaxis(C, 0, -1)).tobytes())
