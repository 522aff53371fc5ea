"""Pictures for people: the preview that every measurement writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photonormal.export.labels import labelled
from photonormal.export.mesh import display
from photonormal.files.decode import decode, full_scale
from photonormal.files.remarks import is_srgb
from photonormal.masked import made_smaller
from photonormal.scoring import SCALE_DEG, colours
from photonormal.srgb import to_linear
from photonormal.types import InputError, Normals

PREVIEW_HEIGHT = 480  # pixels; larger frames are reduced to it
THUMBNAIL_HEIGHT = 96  # the same of a thumbnail
MARGIN = 4  # pixels around the object in a preview


def preview(
    photograph: np.ndarray,
    normals: Normals,
    albedo: np.ndarray,
    white: float,
    error: np.ndarray | None,
    box: tuple[slice, slice],
) -> np.ndarray:
    """One 8-bit RGB picture: photograph, normals, relit from the upper left, albedo and, if given, the error map.

    All are reduced first, so that large frames take no memory. `photograph` is linear (i, j, 1 or 3), cut to the `box`
    of the frame that is shown, in its size or smaller; `albedo` (h, w, 3) is linear and shown white at `white`; `error`
    (h, w, 3) 8-bit. Each part stands under its name.
    """
    import cv2

    map, rho = (_reduced(v) for v in (normals.map[box], albedo[box]))
    mask = _reduced(normals.mask[box].astype(np.float32)) > 0.5
    map = np.where(mask[..., None], map / np.linalg.norm(map, axis=-1, keepdims=True).clip(1e-6), 0)
    image = photograph
    if image.shape[:2] != mask.shape:
        image = cv2.resize(image, mask.shape[::-1], interpolation=cv2.INTER_AREA)
    image = image.reshape(*mask.shape, -1)
    image = image / max(float(np.quantile(image[mask], 0.99)), 1e-6)
    panels = {
        "photograph": display(np.broadcast_to(image, map.shape)),
        "normals": _on_white(np.rint(127.5 * (map + 1)).astype(np.uint8), mask),
        "relit": relit(map, mask),
        "albedo": _on_white(display(rho / white), mask),
    }
    if error is not None:
        panels[f"error, 0 to {SCALE_DEG:g} deg"] = _reduced(error[box])
    shown = [labelled(panel, name) for name, panel in panels.items()]
    gap = np.full((shown[0].shape[0], 6, 3), 255, np.uint8)
    return np.concatenate([part for panel in shown for part in (panel, gap)][:-1], axis=1)


def thumbnail(normals: Normals, box: tuple[slice, slice]) -> np.ndarray:
    """One 8-bit RGB picture of a height of THUMBNAIL_HEIGHT at most: normals, relit from the upper left and, where they
    are known, expected errors in colours; of the `box` of the frame."""
    map, errors = _reduced(normals.map[box], THUMBNAIL_HEIGHT), normals.expected_error_deg
    mask = _reduced(normals.mask[box].astype(np.float32), THUMBNAIL_HEIGHT) > 0.5
    map = np.where(mask[..., None], map / np.linalg.norm(map, axis=-1, keepdims=True).clip(1e-6), 0)
    shown = [_on_white(np.rint(127.5 * (map + 1)).astype(np.uint8), mask), relit(map, mask)]
    if errors is not None:
        nearest = np.ix_(*(np.arange(n) * m // n for n, m in zip(mask.shape, errors[box].shape, strict=True)))
        shown.append(_on_white(colours(errors[box][nearest]), mask))
    gap = np.full((len(mask), 4, 3), 255, np.uint8)
    return np.concatenate([part for picture in shown for part in (picture, gap)][:-1], axis=1)


def _reduced(picture: np.ndarray, height: int = PREVIEW_HEIGHT) -> np.ndarray:
    """The picture at a height of so many pixels at most."""
    return made_smaller(picture, height / len(picture))


def linear(samples: np.ndarray, encoded: bool) -> np.ndarray:
    """Linear colours (h, w, 3) in [0, 1], float32, of decoded samples (h, w, 1 or 3), sRGB-encoded or not."""
    level = np.broadcast_to(samples / np.float32(full_scale(samples)), (*samples.shape[:2], 3))
    return (to_linear(level) if encoded else level).clip(0, 1)


def is_encoded(path: Path, samples: np.ndarray) -> bool:
    """Whether a picture that people look at is sRGB-encoded: 8 bits are, others where they say so."""
    return samples.dtype == np.uint8 or is_srgb(path)


def read_colours(path: Path, frame: tuple[int, int]) -> np.ndarray:
    """Linear colours (h, w, 3) in [0, 1] of a picture of the size `frame`: an `albedo.png`, or any picture that people
    look at."""
    samples = decode(path, frame)
    return linear(samples, is_encoded(path, samples))


def albedo_samples(path: Path) -> np.ndarray:
    """The samples (h, w, 3) of an `albedo.png`, 16-bit.

    Raises
    ------
    InputError
        If the file is cut short or no 16-bit colour PNG.
    """
    samples = decode(path)
    if samples.shape[2] != 3 or samples.dtype != np.uint16:
        raise InputError(f"{path} is no 16-bit colour PNG; measure again.")
    return samples


def read_albedo(path: Path) -> np.ndarray:
    """The linear albedo (h, w, 3) in [0, 1] of an `albedo.png`, float32; the file says whether it is sRGB-encoded."""
    samples = albedo_samples(path)
    return linear(samples, is_encoded(path, samples))


def relit(map: np.ndarray, mask: np.ndarray, light: tuple[float, float, float] = (-0.5, 0.5, 0.707)) -> np.ndarray:
    """A matt white surface with these normals under one light: the quickest check that they are the right way round."""
    direction = np.array(light, np.float32) / np.linalg.norm(light)
    return _on_white(display(np.repeat((map @ direction)[..., None], 3, axis=-1)), mask)


def _on_white(picture: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.where(mask[..., None], picture, np.uint8(255))
