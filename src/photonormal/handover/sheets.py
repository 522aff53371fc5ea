"""What lies on a surface as pictures of one size: cut to the object, and made to repeat."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt

from photonormal.export.heights import heights_px
from photonormal.geometry import normalised
from photonormal.handover.occlusion import openness
from photonormal.handover.surfaces import Relief
from photonormal.integration import integrate
from photonormal.integration.periodic import divergence, poisson
from photonormal.types import InputError, Normals, box_of

FILLED = 0.9  # share of a tile's pixels that must be known; the others take their neighbours' values
STEEPEST = 20.0  # slope of a normal in a tile


@dataclass(frozen=True)
class Sheet:
    """The layers of a surface.

    Parameters
    ----------
    colour : (h, w, 3) albedo, linear, from 0 to 1
    normals : (h, w, 3) x right, y up, z to the camera
    height : (h, w) towards the camera in pixels, NaN where it is unknown
    occlusion : (h, w) from 0, buried, to 1, open
    roughness, metalness : (h, w) from 0 to 1, None where they are unknown
    """

    colour: Float[np.ndarray, "h w 3"]
    normals: Float[np.ndarray, "h w 3"]
    height: Float[np.ndarray, "h w"]
    occlusion: Float[np.ndarray, "h w"]
    roughness: Float[np.ndarray, "h w"] | None
    metalness: Float[np.ndarray, "h w"] | None

    def packed(self) -> Float[np.ndarray, "h w 3"]:
        """Occlusion, roughness, metalness in one picture; rough and no metal where nothing is known."""
        rough = np.ones_like(self.occlusion) if self.roughness is None else self.roughness
        metal = np.zeros_like(self.occlusion) if self.metalness is None else self.metalness
        return np.stack([self.occlusion, rough, metal], axis=-1)


def sheet(found: Relief, margin: int = 0) -> Sheet:
    """The layers of the object's box and of `margin` pixels around it, the nearest values where there are none."""
    box = box_of(found.known, margin)
    known = found.known[box]
    height = np.where(known, heights_px(found.surface)[box], np.nan)
    normals = found.normals.map[box]
    roughness, metalness = (None if v is None else spread(v[box], known) for v in (found.roughness, found.metalness))
    return Sheet(
        spread(found.albedo[box], known),
        spread(normals, known),
        height,
        spread(openness(height, normals), known),
        roughness,
        metalness,
    )


def spread(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values everywhere: where they are unknown, the nearest known one's."""
    if known.all():
        return values
    nearest = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    return values[nearest[0], nearest[1]]


def repeating(flat: Sheet, of: Path) -> Sheet:
    """Layers whose right edge meets the left one, and whose lower edge meets the upper one.

    What a layer's edges differ by is spread over all of it; slopes lose their mean, which no tile can have. Height is
    integrated anew from the normals, occlusion found anew from it.

    Raises
    ------
    InputError
        If the object does not fill its box. `of` is what the message names.
    """
    share = float(np.isfinite(flat.height).mean())
    if share < FILLED:
        raise InputError(
            f"the object of {of} fills {100 * share:.0f} % of its rectangle but --tile needs one that is full; measure "
            "a part of the photographs with --crop x,y,width,height."
        )
    slopes = flat.normals[..., :2] / np.maximum(flat.normals[..., 2:], 1 / STEEPEST)
    closed_slopes = np.stack([closed(slopes[..., k]) for k in range(2)], axis=-1)
    closed_slopes -= closed_slopes.mean((0, 1))
    normals = normalised(np.concatenate([closed_slopes, np.ones((*flat.height.shape, 1))], axis=-1)).astype(np.float32)
    height = integrate(Normals(normals, np.ones(flat.height.shape, bool)), "periodic").depth
    around = [(side // 2, side // 2) for side in height.shape]
    inside = tuple(slice(start, start + side) for (start, _), side in zip(around, height.shape, strict=True))
    open_ = openness(np.pad(height, around, "wrap"), np.pad(normals, [*around, (0, 0)], "wrap"))[inside]
    return replace(
        flat,
        colour=np.stack([closed(flat.colour[..., k]).clip(0, 1) for k in range(3)], axis=-1),
        normals=normals,
        height=height,
        occlusion=open_,
        roughness=None if flat.roughness is None else closed(flat.roughness).clip(0, 1),
        metalness=None if flat.metalness is None else closed(flat.metalness).clip(0, 1),
    )


def closed(layer: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """A layer of the same mean whose edges meet: its steps inside in least squares, and none from edge to edge."""
    v = layer.astype(np.float64)
    right, down = np.roll(v, -1, 1) - v, np.roll(v, -1, 0) - v
    right[:, -1] = 0
    down[-1] = 0
    return (poisson(divergence(right, down)) + v.mean()).astype(np.float32)
