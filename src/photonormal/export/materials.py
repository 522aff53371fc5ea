"""Maps of materials as 3D programs take them: base colour, roughness, metalness, specular level; 8-bit PNG."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from photonormal.disk import Batch
from photonormal.export.mesh import display
from photonormal.png import SRGB, encode_png
from photonormal.types import Materials

ROWS = 256  # made at a time
PLAIN = 0.08  # F0 of level 1, as principled shaders have it
TOLD = 128, 255  # grey of material_known.png: roughness is told; metalness, too


def write_materials(materials: Materials, mask: Bool[np.ndarray, "h w"], white: float, folder: Batch) -> None:
    """base_colour.png (sRGB-encoded; of metals it is F0), roughness.png, metalness.png, specular.png (F0 over 0.08).

    material_known.png is grey where roughness was told, and white where metalness was, too.

    What is not told is taken from the nearest pixel where it is, else matt; `white` is the radiance of a white surface.
    """
    known = np.isfinite(materials.roughness)
    sure = np.isfinite(materials.metalness)
    metal = filled(materials.metalness, sure, 0.0)
    told = known.astype(np.uint8) * TOLD[0]
    told[sure] = TOLD[1]
    base, F0 = np.empty(materials.albedo.shape, np.uint8), np.empty(mask.shape, np.float32)
    for y in range(0, len(base), ROWS):
        rows = slice(y, y + ROWS)
        own = (metal[rows] * sure[rows])[..., None]
        base[rows] = display(((1 - own) * materials.albedo[rows] + own * materials.specular[rows]) / white)
        F0[rows] = materials.specular[rows].mean(-1)
    folder.write("base_colour.png", encode_png(base, SRGB))
    folder.write("metalness.png", encode_png(_bytes(metal * mask)))
    folder.write("roughness.png", encode_png(_bytes(filled(materials.roughness, known, 1.0) * mask)))
    folder.write("specular.png", encode_png(_bytes(filled(F0, known, 0.0) * mask / (PLAIN * white))))
    folder.write("material_known.png", encode_png(told))


def filled(map: Float[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"], otherwise: float) -> Float[np.ndarray, "h w"]:
    """The map where it is known, and elsewhere what the nearest such pixel has; `otherwise` where none is known."""
    import cv2

    if not known.any():
        return np.full(map.shape, otherwise, np.float32)
    source = (~known).astype(np.uint8)
    label: np.ndarray = cv2.distanceTransformWithLabels(source, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[
        1
    ].astype(np.intp, copy=False)
    values = np.zeros(label.max() + 1, np.float32)
    values[label[known]] = map[known]
    return values[label]


def _bytes(map: Float[np.ndarray, "h w"]) -> np.ndarray:
    return np.rint(255 * map.clip(0, 1)).astype(np.uint8)
