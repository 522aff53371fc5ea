"""Pictures for people: the preview that every measurement writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from photonormal.export.labels import labelled
from photonormal.export.mesh import display
from photonormal.files.decode import decode, full_scale
from photonormal.files.remarks import is_srgb
from photonormal.score import SCALE_DEG
from photonormal.srgb import to_linear
from photonormal.types import InputError, Normals, box_of

PREVIEW_HEIGHT = 480  # pixels; larger frames are reduced to it
MARGIN = 4  # pixels around the object in a preview


def preview(
    photograph: np.ndarray, normals: Normals, albedo: np.ndarray, error: np.ndarray | None = None
) -> np.ndarray:
    """One 8-bit RGB picture: photograph, normals, relit from the upper left, albedo and, if given, the error map.

    `photograph` is linear (h, w, 1 or 3) with the object's brightest parts near 1, `albedo` (h, w, 3) in [0, 1],
    `error` (h, w, 3) 8-bit. Cut to the object's box; each part stands under its name.
    """
    box = box_of(normals.mask, MARGIN)
    normals_picture = np.rint(127.5 * (normals.map + 1)).astype(np.uint8)
    normals_picture[~normals.mask] = 255
    panels = {
        "photograph": display(np.broadcast_to(photograph, normals.map.shape))[box],
        "normals": normals_picture[box],
        "relit": relit(normals)[box],
        "albedo": _on_white(display(albedo), normals.mask)[box],
    }
    if error is not None:
        panels[f"error, 0 to {SCALE_DEG:g} deg"] = error[box]
    shown = [labelled(_reduced(panel), name) for name, panel in panels.items()]
    gap = np.full((shown[0].shape[0], 6, 3), 255, np.uint8)
    return np.concatenate([part for panel in shown for part in (panel, gap)][:-1], axis=1)


def _reduced(panel: np.ndarray) -> np.ndarray:
    import cv2

    scale = PREVIEW_HEIGHT / panel.shape[0]
    return panel if scale >= 1 else cv2.resize(panel, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


def read_colours(path: Path, frame: tuple[int, int]) -> np.ndarray:
    """Linear colours (h, w, 3) in [0, 1] of a picture of the size `frame`: an `albedo.png`, or any picture that people
    look at, whose 8 bits are sRGB-encoded."""
    value = decode(path, frame)
    level = np.broadcast_to(value / np.float32(full_scale(value)), (*value.shape[:2], 3))
    if value.dtype == np.uint8 or is_srgb(path):
        level = to_linear(level)
    return level.clip(0, 1)


def read_albedo(path: Path) -> np.ndarray:
    """The linear albedo (h, w, 3) in [0, 1] of an `albedo.png`, float32; it tells whether it is sRGB-encoded.

    Raises
    ------
    InputError
        If the file is cut short or no 16-bit colour PNG.
    """
    value = decode(path)
    if value.shape[2] != 3 or value.dtype != np.uint16:
        raise InputError(f"{path} is no 16-bit colour PNG; measure again.")
    level = value / np.float32(65535)
    return to_linear(level) if is_srgb(path) else level


def relit(normals: Normals, light: tuple[float, float, float] = (-0.5, 0.5, 0.707)) -> np.ndarray:
    """A matt white surface with these normals under one light: the quickest check that they are the right way round."""
    direction = np.array(light, np.float32) / np.linalg.norm(light)
    return _on_white(display(np.repeat((normals.map @ direction)[..., None], 3, axis=-1)), normals.mask)


def _on_white(picture: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.where(mask[..., None], picture, np.uint8(255))
