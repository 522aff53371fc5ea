"""The object's mask from its shading, where nobody drew one."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, UInt8

from photonormal.masked import made_smaller, on_rim
from photonormal.types import InputError

SIZE = 600  # longest side at which the mask is found
BRIGHT = 0.9  # quantile over the pictures that stands for a pixel's brightness: shadows and highlights leave it alone
HOLE = 0.01  # part of the object's area below which a hole in it is a dark spot of the object
UNSURE = 12  # levels of 255 around the split that the picture's edges decide
SMALLEST = 0.005  # part of the frame that an object covers at least
BORDER = 0.25  # part of the frame's border that an object may touch: more is a wall or a table
SPLITS = 3  # brightnesses tried, each among what was brighter than the one before


def mask_from_shading(pictures: Float[np.ndarray, "n h w"]) -> Bool[np.ndarray, "h w"]:
    """The largest of `things_from_shading`."""
    return things_from_shading(pictures)[0]


def things_from_shading(pictures: Float[np.ndarray, "n h w"]) -> list[Bool[np.ndarray, "h w"]]:
    """The lit things on a darker ground, without small holes, the largest first.

    Pixels are split in two by the logarithm of their brightness (Otsu), again among the brighter ones while what is
    left touches too much of the border; the split is refined along edges (GrabCut).

    Raises
    ------
    InputError
        If nothing stands out, or what does fills the frame.
    """
    import cv2

    level = np.quantile(pictures, BRIGHT, axis=0).astype(np.float32)
    h, w = level.shape
    level = made_smaller(level, SIZE / max(h, w))
    white = max(float(np.quantile(level, 0.99)), 1e-12)
    log = np.log(level / white + 0.01).clip(np.log(0.01), 0)
    grey = cv2.GaussianBlur(np.rint(255 * (1 - log / np.log(0.01))).astype(np.uint8), (0, 0), 1.5)
    split = -1.0
    for _ in range(SPLITS):
        brighter = grey[grey > split]
        if brighter.size < SMALLEST * grey.size or brighter.min() == brighter.max():
            break
        split, _ = cv2.threshold(brighter[None], 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        things = _things(_cut(grey, split))
        if not things:
            break
        if on_rim(things[0] > 0) <= BORDER:
            return [cv2.resize(thing, (w, h), interpolation=cv2.INTER_LINEAR) > 0 for thing in things]
    raise InputError("no object stands out of a darker ground in these photographs; draw a mask, white on the object.")


def _cut(grey: UInt8[np.ndarray, "h w"], split: float) -> UInt8[np.ndarray, "h w"]:
    """1 where a pixel is brighter than `split`, its edges moved to those of the picture."""
    import cv2

    sure, ground = grey > split + UNSURE, grey < split - UNSURE
    if not (sure.any() and ground.any()):
        return (grey > split).astype(np.uint8)
    labels = np.where(grey > split, np.where(sure, cv2.GC_FGD, cv2.GC_PR_FGD), cv2.GC_PR_BGD)
    labels[ground] = cv2.GC_BGD
    colour, models = np.repeat(grey[..., None], 3, axis=-1), (np.zeros((1, 65)), np.zeros((1, 65)))
    cv2.setRNGSeed(0)  # its clusters begin at random: the same pictures are to give the same mask
    cut = cv2.grabCut(colour, labels.astype(np.uint8), (0, 0, 0, 0), *models, 3, cv2.GC_INIT_WITH_MASK)[0]
    return np.isin(cut, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)


def _things(lit: UInt8[np.ndarray, "h w"]) -> list[UInt8[np.ndarray, "h w"]]:
    """Its parts that are large enough, each with the smaller holes in it, the largest first."""
    import cv2

    lit = cv2.morphologyEx(lit, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(lit)
    area = stats[1:, cv2.CC_STAT_AREA]
    order = np.argsort(-area, kind="stable")
    return [_without_holes((labels == 1 + k).astype(np.uint8)) for k in order if area[k] >= SMALLEST * lit.size]


def _without_holes(object: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - object)
    small = np.flatnonzero(stats[:, cv2.CC_STAT_AREA] < HOLE * object.sum())
    return np.maximum(object, np.isin(labels, small[small > 0]).astype(np.uint8))
