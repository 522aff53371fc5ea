"""Fits as files: .ptm (Hewlett-Packard's format 1.2) and .rti with hemispherical harmonics."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from photonormal.progress import progress
from photonormal.relighting import FORMATS
from photonormal.relighting.codes import Codes
from photonormal.relighting.fit import Band, Fit
from photonormal.types import Capture, InputError

LARGEST = 2**31 - 1  # bytes: many viewers count them in 32 bits


def write(capture: Capture, kind: str, path: Path) -> None:
    """Fit the photographs, and write the fit of the mask's box to a file; pixels outside the mask are black.

    The photographs are gone through twice, some rows at a time: for the coefficients' ranges, then to store them.

    Parameters
    ----------
    kind : a key of FORMATS whose ending is a file's
    path : the file, which is made or emptied

    Raises
    ------
    InputError
        If the capture's lights are unknown or too few, or the file would be larger than viewers can read.
    """
    fit = Fit(capture, FORMATS[kind].basis)
    h, w = fit.size
    k = fit.terms
    lrgb = kind == "ptm"
    size = h * w * (k + 3 if lrgb else 3 * k)
    if size > LARGEST:
        raise InputError(
            f"a {kind} file of {w} x {h} pixels would have {size} bytes but viewers read at most {LARGEST}; measure a "
            "part of the photographs with --crop, or reduce them with --scale."
        )
    white = fit.white()
    split = _lrgb if lrgb else _rgb
    with progress("fit to the light", 2 * int(capture.mask.sum())) as advance:

        def bands() -> Iterator[tuple[Band, np.ndarray, np.ndarray]]:
            for band in fit.bands(white):
                yield band, *split(band)
                advance(len(band.coefficients))

        codes = Codes.of(C.swapaxes(1, 2).reshape(-1, k) for _, C, _ in bands())
        if kind.startswith("ptm"):
            _ptm(path, (h, w), bands(), codes, channels=1 if lrgb else 3)
        else:
            _rti(path, (h, w), bands(), codes)


def _rgb(band: Band) -> tuple[Float[np.ndarray, "p k 3"], np.ndarray]:
    """Coefficients of red, green and blue."""
    return band.rgb, np.empty((len(band.rgb), 0))


def _lrgb(band: Band) -> tuple[Float[np.ndarray, "p k 1"], Float[np.ndarray, "p 3"]]:
    """Coefficients of one luminance, and a colour, of at most 1, that multiplies it: least squares over the lights."""
    Y = band.shown.mean(-1)  # (p, n)
    colour = (band.shown * Y[..., None]).sum(1) / np.maximum((Y**2).sum(1), 1e-9)[:, None]
    colour = np.broadcast_to(colour, (len(Y), 3))
    most = np.maximum(colour.max(1), 1e-9)
    return band.coefficients.mean(-1, keepdims=True) * most[:, None, None], colour / most[:, None]


def _ptm(path: Path, size: tuple[int, int], bands: Iterator, codes: Codes, channels: int) -> None:
    """Coefficients are (code - bias) scale in 255ths of white; rows from the bottom to the top. A block for each
    channel, RGB; of one channel, the luminance of LRGB, a block of colours follows."""
    h, w = size
    lrgb = channels == 1
    numbers = " ".join(f"{255 * s:.9g}" for s in codes.step), " ".join(f"{int(z)}" for z in codes.zero)
    lines = ["PTM_1.2", "PTM_FORMAT_LRGB" if lrgb else "PTM_FORMAT_RGB", str(w), str(h), *numbers]
    start = "".join(f"{line}\n" for line in lines).encode()
    body = _body(path, start, h * w * (9 if lrgb else 18))
    blocks = body[: channels * h * w * 6].reshape(channels, h, w, 6)[:, ::-1]
    colours = body[channels * h * w * 6 :].reshape(h, w, -1)[::-1]
    for y in range(h):
        blocks[:, y] = codes.zero
    for band, C, colour in bands:
        for channel in range(channels):
            blocks[channel, band.rows][band.on] = codes(C[..., channel])
        if lrgb:
            colours[band.rows][band.on] = np.rint(255 * colour)
    body.flush()


def _rti(path: Path, size: tuple[int, int], bands: Iterator, codes: Codes) -> None:
    """Coefficients are code / 255 scale + bias, white is 1; rows from the top, in each pixel red, green, blue."""
    h, w = size
    k = len(codes.step)
    start = f"#HSH1.2\r\n3\r\n{w} {h} 3\r\n{k} 2 1\r\n".encode()
    ranges = np.concatenate([255 * codes.step, -codes.zero * codes.step]).astype("<f4").tobytes()
    stored = _body(path, start + ranges, h * w * 3 * k)
    body = stored.reshape(h, w, 3, k)
    for y in range(h):
        body[y] = codes.zero
    for band, C, _ in bands:
        body[band.rows][band.on] = codes(C.swapaxes(1, 2))
    stored.flush()


def _body(path: Path, start: bytes, size: int) -> np.memmap:
    """A file that begins so, and the bytes that follow."""
    path.write_bytes(start)
    return np.memmap(path, np.uint8, "r+", offset=len(start), shape=(size,))
