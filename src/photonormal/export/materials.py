"""Maps of materials as 3D programs take them: base colour, roughness, metalness, specular level; 8-bit PNG."""

from __future__ import annotations

from functools import partial

import numpy as np
from jaxtyping import Bool, Float, UInt8

from photonormal.disk import FileBatch
from photonormal.export.mesh import display
from photonormal.masked import means
from photonormal.png import SRGB, by_rows, encode_png
from photonormal.types import Materials, RowMap

ROWS = 256  # made at a time
TOP, USUAL = 0.08, 0.04  # F0 of level 1, as principled shaders have it; of nearly all that is no metal
ENOUGH = 2**20  # pixels that show the usual F0
TOLD = 128, 255  # grey of material_known.png: roughness is known; metalness, too


def write_materials(materials: Materials, mask: Bool[np.ndarray, "h w"], white: float, folder: FileBatch) -> None:
    """base_colour.png (sRGB-encoded), roughness.png, metalness.png, specular.png (F0 over 0.08).

    The base colour is the albedo; of metals F0, or both where only a neighbour shows that it is one. Photographs do not
    show the exposure, so the median F0 of what is no metal counts as 0.04.

    material_known.png is grey where roughness is known, and white where metalness is, too.

    What is not known is what is known around it, else matt; `white` is the radiance of a white surface.
    """
    sure, metal = _told(materials.metalness, unknown=0)
    fill(sure, metal)
    metal[metal > 127], metal[metal <= 127] = 255, 0
    folder.write("base_colour.png", by_rows(partial(_base, materials, white, sure, metal), mask.shape, np.uint8, SRGB))
    folder.write("metalness.png", encode_png(metal * mask))
    del metal  # one map is written before the next is made
    known, rough = _told(materials.roughness, unknown=1)
    folder.write("material_known.png", encode_png(np.where(sure, np.uint8(TOLD[1]), known * np.uint8(TOLD[0]))))
    del sure
    fill(known, rough)
    folder.write("roughness.png", encode_png(rough * mask))
    del rough
    level, full = np.empty(mask.shape, np.uint8), TOP / USUAL * _usual(materials)
    for rows in _bands(mask):
        level[rows] = _bytes(materials.specular[rows].mean(-1) / full)
    fill(known, level)
    folder.write("specular.png", encode_png(level * mask))


def _base(
    materials: Materials,
    white: float,
    sure: Bool[np.ndarray, "h w"],
    metal: UInt8[np.ndarray, "h w"],
    rows: slice,
) -> UInt8[np.ndarray, "r w 3"]:
    """Some rows of the base colour, where it is known which pixels are of a metal."""
    bare = np.where(sure[rows], materials.metalness[rows], 0)[..., None]
    shine = materials.specular[rows] * (metal[rows, :, None] / np.float32(255))
    return display((materials.albedo[rows] * (1 - bare) + shine) / white)


def _told(map: RowMap, unknown: float) -> tuple[Bool[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]:
    """Where a map is known, and its levels, those of `unknown` elsewhere."""
    known, level = np.empty(map.shape, bool), np.empty(map.shape, np.uint8)
    for rows in _bands(map):
        part = map[rows]
        known[rows] = np.isfinite(part)
        level[rows] = _bytes(np.where(known[rows], part, unknown))
    return known, level


def _bands(map: np.ndarray | RowMap) -> list[slice]:
    """Some of its rows after the other."""
    return [slice(y, y + ROWS) for y in range(0, map.shape[0], ROWS)]


def _usual(materials: Materials) -> float:
    """The median F0 of what is known to be no metal, 1 where nothing is."""
    h, w = materials.roughness.shape
    step = max(1, int(np.sqrt(h * w / ENOUGH)))
    rough, metal, F0 = (
        each[::step][:, ::step] for each in (materials.roughness, materials.metalness, materials.specular)
    )
    values = F0.mean(-1)[np.isfinite(rough) & (metal != 1)]
    return float(np.median(values)) or 1.0 if len(values) else 1.0


def fill(known: Bool[np.ndarray, "h w"], picture: UInt8[np.ndarray, "h w"]) -> None:
    """Put into a picture, where nothing is known, a blend of what is known around; nothing where nothing is at all.

    Means of known pixels over squares of 2, 4, 8 ... a side fill what smaller ones leave open (Gortler et al., The
    Lumigraph, SIGGRAPH 1996: pull and push).
    """
    import cv2

    if not known.any() or known.all():
        return
    h, w = known.shape
    parts = _bands(known)
    share = np.concatenate([means(known[rows].astype(np.float32), 2) for rows in parts])
    total = np.concatenate([means((picture[rows] * known[rows]).astype(np.float32), 2) for rows in parts])
    around = np.rint(_filled(total, share)).astype(np.uint8)
    around = cv2.resize(around, (w, h), interpolation=cv2.INTER_LINEAR)
    for rows in parts:
        np.copyto(picture[rows], around[rows], where=~known[rows])


def _filled(total: Float[np.ndarray, "h w"], share: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Means of squares where a quarter of one or more is known, and the less of them the less it is, in place of those
    around."""
    import cv2

    mean, share = total / np.maximum(share, 1e-9), np.minimum(1, 4 * share)
    if share.min() >= 1 or share.size == 1:
        return mean
    h, w = share.shape
    coarse = _filled(means(mean * share, 2), means(share, 2))
    around = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_LINEAR)
    return around + (mean - around) * share


def _bytes(map: Float[np.ndarray, "h w"]) -> np.ndarray:
    return np.rint(255 * map.clip(0, 1)).astype(np.uint8)
