"""A sheet made to repeat: its right edge meets its left one, and its lower edge its upper one."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Float

from photonormal.files import memory
from photonormal.files.rows import Rows
from photonormal.geometry import normalised
from photonormal.handover import occlusion
from photonormal.handover.sheets import Layers, Sheet, between_points
from photonormal.handover.surfaces import picture_rows
from photonormal.integration import integrate
from photonormal.integration.periodic import periodic_poisson
from photonormal.types import InputError, Normals

log = logging.getLogger(__name__)

FILLED = 0.9  # share of a tile's pixels that must be known; the others take their neighbours' values
STEEPEST = 20.0  # slope of a normal in a tile
BENT = 0.2  # change of slopes, on average, above which a tile is no picture of the object
HELD = 100  # bytes of each pixel while its height is found


@contextmanager
def repeating(flat: Layers, of: Path) -> Iterator[Layers]:
    """Layers whose right edge meets the left one, and whose lower edge meets the upper one.

    What a layer's edges differ by is spread over all of it; slopes lose their mean, which no tile can have. Height is
    integrated anew from the normals, occlusion found anew from it.

    Raises
    ------
    InputError
        If the object does not fill its box, or the tile the memory. `of` is what the message names.
    """
    h, w = flat.size
    needed = HELD * h * w
    if needed > memory.allowed():
        raise InputError(
            f"a tile of {w} x {h} pixels needs {memory.text_of(needed)} but {memory.text_of(memory.allowed())} of "
            f"memory is allowed; measure a smaller --crop or allow more, such as --memory {memory.text_of(needed, '')}."
        )
    with ExitStack() as kept:
        planes = [kept.enter_context(Rows((h, w), np.float32)) for _ in range(7)]
        known = 0
        for rows, part in flat.parts():
            slopes = part.normals[..., :2] / np.maximum(part.normals[..., 2:], 1 / STEEPEST)
            values = [*np.moveaxis(part.colour, 2, 0), *np.moveaxis(slopes, 2, 0), part.roughness, part.metalness]
            for plane, value in zip(planes, values, strict=True):
                if value is not None:
                    plane[rows] = value
            known += int(np.isfinite(part.height).sum())
        share = known / (h * w)
        if share < FILLED:
            raise InputError(
                f"the object of {of} fills {100 * share:.0f} % of its rectangle but --tile needs one that is full; "
                "measure a part of the photographs with --crop x,y,width,height."
            )
        bent = 0.0  # how much closing changed the slopes, besides their mean
        for k, plane in enumerate(planes):
            layer = closed(plane[:])
            if k in (3, 4):
                bent = max(bent, float(np.abs(layer - plane[:]).mean()))
                layer -= layer.mean()
            plane[:] = layer if k in (3, 4) else layer.clip(0, 1)
        if bent > BENT:
            log.warning(
                "photonormal: the edges of %s hardly meet: closing the tile changes its slopes by %.1f on average: it "
                "looks unlike the object. Measure a flatter part of the photographs with --crop x,y,width,height.",
                of,
                bent,
            )
        yield _tile(flat, *planes)


def _tile(flat: Layers, *planes: Rows) -> Layers:
    red, green, blue, p, q, rough, metal = planes
    h, w = flat.size
    normals = np.empty((h, w, 3), np.float32)
    for rows in picture_rows(h, w):
        slopes = p[rows], q[rows]
        normals[rows] = normalised(np.stack([*slopes, np.ones_like(slopes[0])], axis=-1))
    height = integrate(Normals(normals, np.ones((h, w), bool)), "periodic").depth
    step = occlusion.step_for(2 * h, 2 * w)
    some, N = height[::step, ::step], normals[::step, ::step]
    around = [(side // 2, side // 2) for side in some.shape]
    inside = tuple(slice(start, start + side) for (start, _), side in zip(around, some.shape, strict=True))
    wrapped = np.pad(some, around, "wrap"), np.pad(N, [*around, (0, 0)], "wrap")
    open_ = np.pad(occlusion.openness(*wrapped, step)[inside], [(0, 1), (0, 1)], "wrap")
    first = flat.part(slice(0, 1))

    def part(rows: slice) -> Sheet:
        return Sheet(
            np.stack([plane[rows] for plane in (red, green, blue)], axis=-1),
            normals[rows],
            height[rows],
            between_points(open_, np.arange(h)[rows] / step, np.arange(w) / step),
            None if first.roughness is None else rough[rows],
            None if first.metalness is None else metal[rows],
        )

    return Layers((h, w), part, (float(height.min()), float(height.max())))


def closed(layer: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """A layer of the same mean whose edges meet: its steps inside in least squares, and none from edge to edge."""
    seam = np.zeros(layer.shape)  # the divergence of the steps from edge to edge, which are to vanish
    for across, along in ((layer, seam), (layer.T, seam.T)):
        jump = across[:, -1].astype(np.float64) - across[:, 0]
        along[:, -1] += jump
        along[:, 0] -= jump
    return layer + periodic_poisson(seam).astype(np.float32)
