"""Maps of materials as 3D programs take them: base colour, roughness, metalness, specular level; 8-bit PNG."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from photonormal.disk import Batch
from photonormal.export.mesh import display
from photonormal.png import SRGB, encode_png
from photonormal.types import Materials

ROWS = 256  # made at a time
PLAIN = 0.08  # F0 of level 1, as principled shaders have it
TOLD = 128, 255  # grey of material_known.png: roughness is told; metalness, too


def write_materials(materials: Materials, mask: Bool[np.ndarray, "h w"], white: float, folder: Batch) -> None:
    """base_colour.png (sRGB-encoded), roughness.png, metalness.png, specular.png (F0 over 0.08).

    The base colour is the albedo; of metals F0, or both where only a neighbour tells that it is one.

    material_known.png is grey where roughness was told, and white where metalness was, too.

    What is not told is taken from the nearest pixel where it is, else matt; `white` is the radiance of a white surface.
    """
    known, sure = np.isfinite(materials.roughness), np.isfinite(materials.metalness)
    told = known.astype(np.uint8) * TOLD[0]
    told[sure] = TOLD[1]
    base = np.empty(materials.albedo.shape, np.uint8)
    rough, metal, level = (np.empty(mask.shape, np.uint8) for _ in range(3))
    bands = [slice(y, y + ROWS) for y in range(0, len(base), ROWS)]
    for rows in bands:
        metal[rows] = _bytes(np.where(sure[rows], materials.metalness[rows], 0))
        rough[rows] = _bytes(np.where(known[rows], materials.roughness[rows], 1))
        level[rows] = _bytes(materials.specular[rows].mean(-1) / (PLAIN * white))
    spread(sure, metal)
    spread(known, rough, level)
    for rows in bands:
        bare = np.where(sure[rows], materials.metalness[rows], 0)[..., None]
        shine = materials.specular[rows] * (metal[rows, :, None] / np.float32(255))
        base[rows] = display((materials.albedo[rows] * (1 - bare) + shine) / white)
    folder.write("base_colour.png", encode_png(base, SRGB))
    folder.write("material_known.png", encode_png(told))
    for name, picture in (("metalness", metal), ("roughness", rough), ("specular", level)):
        folder.write(f"{name}.png", encode_png(picture * mask))


def spread(known: Bool[np.ndarray, "h w"], *pictures: UInt8[np.ndarray, "h w"]) -> None:
    """Put into pictures, where nothing is known, what the nearest pixel has where it is; nothing if there is none."""
    import cv2

    if not known.any():
        return
    unknown = (~known).astype(np.uint8)
    nearest = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    number: np.ndarray = nearest[1].astype(np.int32, copy=False)  # of the nearest known pixel
    del nearest
    values = np.zeros((len(pictures), int(number.max()) + 1), np.uint8)
    parts = [slice(y, y + ROWS) for y in range(0, len(known), ROWS)]
    for picture, each in zip(pictures, values, strict=True):
        for rows in parts:
            each[number[rows][known[rows]]] = picture[rows][known[rows]]
        for rows in parts:
            picture[rows] = each[number[rows]]


def _bytes(map: Float[np.ndarray, "h w"]) -> np.ndarray:
    return np.rint(255 * map.clip(0, 1)).astype(np.uint8)
