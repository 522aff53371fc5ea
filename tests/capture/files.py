"""Small captures on disk, written by the tests themselves, and the messages of refusals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from photonormal.types import InputError

LIGHTS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8], [-0.48, 0.36, 0.8]])
MASK = np.zeros((24, 30), bool)
MASK[9:14, 10:18] = True


def samples(j: int = 0, dtype: type = np.uint16, channels: int = 3) -> np.ndarray:
    """The `j`-th picture, (24, 30, channels), with every bit in use: black and full scale are in it."""
    rng = np.random.default_rng(j)
    if np.dtype(dtype).kind == "f":
        return rng.random((24, 30, channels)).astype(dtype)
    picture = rng.integers(0, np.iinfo(dtype).max, (24, 30, channels), endpoint=True).astype(dtype)
    picture[0, 0], picture[0, 1] = 0, np.iinfo(dtype).max
    return picture


def write_picture(path: Path, picture: np.ndarray, **options) -> Path:
    """`picture` (h, w, c), RGB, in the format of the path's suffix; made folders included."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if picture.ndim == 2:
        picture = picture[..., None]
    if path.suffix in (".tif", ".tiff"):
        import tifffile

        options.setdefault("photometric", "rgb" if picture.shape[2] >= 3 else "minisblack")
        tifffile.imwrite(path, picture if picture.shape[2] > 1 else picture[..., 0], **options)
    elif path.suffix == ".exr":
        import OpenEXR

        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        name, pixels = {1: ("Y", picture[..., 0]), 3: ("RGB", picture), 4: ("RGBA", picture)}[picture.shape[2]]
        OpenEXR.File(header, {name: np.ascontiguousarray(pixels)}).write(str(path))
    elif path.suffix == ".npy":
        np.save(path, picture)
    else:
        import cv2

        order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[picture.shape[2]]
        cv2.imencode(path.suffix, np.ascontiguousarray(picture[..., order]))[1].tofile(path)
    return path


def write_folder(folder: Path, n: int = 4, suffix: str = ".png", dtype: type = np.uint16, channels: int = 3) -> Path:
    """`n` pictures `1.png` ..., their lights and a mask, as a plain folder."""
    for j in range(n):
        write_picture(folder / f"{j + 1}{suffix}", samples(j, dtype, channels))
    np.savetxt(folder / "light_directions.txt", LIGHTS[:n])
    write_picture(folder / "mask.png", MASK.astype(np.uint8) * 255)
    return folder


def box(picture: np.ndarray) -> np.ndarray:
    """The picture with zero outside of what is kept: the mask's box and 8 pixels around it."""
    kept = np.zeros_like(picture)
    kept[1:22, 2:26] = picture[1:22, 2:26]
    return kept


def refusal(call: Callable, *args, **options) -> str:
    """The message of the InputError that a call must raise: one line, a sentence with a remedy."""
    with pytest.raises(InputError) as caught:
        call(*args, **options)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.endswith(".")
    assert ";" in message or "add" in message
    return message


def load_and_decode(path: Path, **options) -> None:
    """Load a capture and decode each of its pictures, as every method does."""
    from photonormal import load

    load(path, **options).map_images(lambda j, image: None)
