"""What lies on a surface as pictures of one size, cut to the object; some rows at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array

from photonormal.handover import occlusion
from photonormal.handover.surfaces import Part, Relief, picture_rows
from photonormal.masked import box_of

AROUND = 32  # rows that are looked at above and below for known pixels


@dataclass(frozen=True)
class Sheet:
    """The layers of some rows of a surface.

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

    def each(self, change: Callable[..., np.ndarray], *others: Sheet) -> Sheet:
        """A sheet whose layers are changed, each by itself and the same layer of others."""
        layers: dict[str, Any] = {f.name: [getattr(one, f.name) for one in (self, *others)] for f in fields(self)}
        changed: dict[str, Any] = {name: None if v[0] is None else change(*v) for name, v in layers.items()}
        return Sheet(**changed)


@dataclass(frozen=True)
class Layers:
    """A sheet of which some rows are made at a time.

    Parameters
    ----------
    size : rows and columns
    part : the sheet of some rows
    heights : the lowest and the highest, pixels
    """

    size: tuple[int, int]
    part: Callable[[slice], Sheet]
    heights: tuple[float, float]

    def parts(self) -> Iterator[tuple[slice, Sheet]]:
        """All of it, some rows after the other."""
        for rows in picture_rows(*self.size):
            yield rows, self.part(rows)

    def reduced(self, side: int) -> Layers:
        """The same with sides of at most `side` pixels, each the mean of the area that it covers."""
        h, w = self.size
        scale = min(1.0, side / max(h, w))
        size = max(1, round(scale * h)), max(1, round(scale * w))
        if size == self.size:
            return self
        down, across = areas(h, size[0]), areas(w, size[1])

        def part(rows: slice) -> Sheet:
            weights = down[rows]
            first, last = int(weights.indices.min()), int(weights.indices.max()) + 1
            weights = weights[:, first:last]

            def reduced(layer: np.ndarray) -> np.ndarray:
                lines = (weights @ layer.reshape(len(layer), -1)).reshape(-1, *layer.shape[1:])
                columns = across @ lines.swapaxes(0, 1).reshape(w, -1)
                return columns.reshape(size[1], len(lines), *layer.shape[2:]).swapaxes(0, 1)

            return self.part(slice(first, last)).each(reduced)

        return Layers(size, part, self.heights)


def areas(n: int, m: int) -> csr_array:
    """(m, n) weights of pixels in each of m equal parts of n of them; each row adds up to 1."""
    edges = np.linspace(0, n, m + 1)
    first, last = np.floor(edges[:-1]).astype(int), np.ceil(edges[1:] - 1e-9).astype(int)
    counts = last - first
    row = np.repeat(np.arange(m), counts)
    column = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts) + first[row]
    share = np.minimum(column + 1, edges[row + 1]) - np.maximum(column, edges[row])
    return csr_array(((share * m / n).astype(np.float32), (row, column)), shape=(m, n))


def sheet(found: Relief, margin: int = 0) -> Layers:
    """The layers of the object's box and of `margin` pixels around it.

    Where nothing is known they are those of the nearest pixel, or farther away of the nearest one on a coarse grid.
    """
    box = box_of(found.known, margin)
    (top, left), (h, w) = zip(*((side.start, side.stop - side.start) for side in box), strict=True)
    step = occlusion.step_for(h, w)
    some = found.part(slice(top, top + h, step), slice(left, left + w, step))
    open_ = occlusion.openness(np.where(some.known, some.height, np.nan), some.normals, step)
    at, _ = nearest(some.known)
    coarse = _sheet(some, open_).each(lambda layer: layer[at[0], at[1]])

    def part(rows: slice) -> Sheet:
        around = slice(max(0, rows.start - AROUND), min(h, rows.stop + AROUND))
        near = found.part(slice(top + around.start, top + around.stop), box[1])
        open_ = between_points(coarse.occlusion, np.arange(around.start, around.stop) / step, np.arange(w) / step)
        seen = _sheet(near, open_)
        if not near.known.all():
            at, distance = nearest(near.known)
            away = distance > AROUND
            row, column = np.nonzero(away)
            row, column = (row + around.start) // step, column // step

            def filled(layer: np.ndarray, far: np.ndarray) -> np.ndarray:
                layer = layer[at[0], at[1]]
                layer[away] = far[row, column]
                return layer

            seen = replace(seen.each(filled, coarse), height=seen.height)
        return seen.each(lambda layer: layer[rows.start - around.start : rows.stop - around.start])

    return Layers((h, w), part, found.heights)


def _sheet(part: Part, open_: Float[np.ndarray, "h w"]) -> Sheet:
    height = np.where(part.known, part.height, np.nan)
    return Sheet(part.albedo, part.normals, height, open_, part.roughness, part.metalness)


def nearest(known: Bool[np.ndarray, "h w"]) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the nearest known pixel, and how far it is; of itself and infinitely, where there is none."""
    if not known.any():
        return np.indices(known.shape), np.full(known.shape, np.inf)
    found: Any = distance_transform_edt(~known, return_indices=True)
    return found[1], found[0]


def between_points(
    grid: Float[np.ndarray, "a b"], rows: Float[np.ndarray, " h"], columns: Float[np.ndarray, " w"]
) -> Float[np.ndarray, "h w"]:
    """Values on a grid between its points, in the grid's rows and columns."""
    for places in (rows, columns):
        first = places.astype(int).clip(0, max(0, len(grid) - 2))
        share = (places - first).clip(0, 1).astype(np.float32)[:, None]
        after = np.minimum(first + 1, len(grid) - 1)
        grid = (grid[first] + share * (grid[after] - grid[first])).T
    return grid
