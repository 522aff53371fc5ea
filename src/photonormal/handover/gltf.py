"""A result as glTF 2.0: its mesh, and the pictures of what lies on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from photonormal.disk import at_once
from photonormal.export.mesh import FACES, display, faces, scale_of, step_for, vertices
from photonormal.geometry import normalised
from photonormal.handover.glb import INDICES, VERTICES, Buffer
from photonormal.handover.opened import refuse
from photonormal.handover.sheets import sheet, spread
from photonormal.handover.surfaces import Relief, relief
from photonormal.png import encode_png
from photonormal.types import Surface, box_of

TEXTURE = 4096  # pixels of a picture's side at most: what every graphics card takes
MARGIN = 8  # pixels around the object in its pictures


def export_gltf(
    result: Path, out: Path, mm_per_px: float | None = None, overwrite: bool = False, most_faces: int = FACES
) -> Path:
    """Write a result as one .glb file: mesh with tangents, base colour, normal map, occlusion.

    The mesh lies around the origin, y up, z to the camera; in metres where the width of a pixel is known, else its
    longer side is 1. Roughness and metalness are written where the result has them.

    Parameters
    ----------
    result : a folder that `measure` wrote
    out : the file to write
    mm_per_px : millimetres that a pixel is wide, where the report does not say
    overwrite : replace a file that exists
    most_faces : of the mesh, about, see `photonormal.export.save`

    Raises
    ------
    InputError
        If the folder is no result with depth and albedo, or the file can't be written.
    """
    refuse("gltf", out, overwrite)
    parts = encoded(relief(result, mm_per_px), most_faces)
    with at_once(out.parent) as batch, (batch / out.name).open("wb") as file:
        file.writelines(parts)
    return out


def encoded(found: Relief, most_faces: int) -> list[bytes]:
    """The parts of the file, one after the other."""
    step = step_for(Surface(found.surface.depth, found.known, found.surface.K), most_faces)
    keep = found.known[::step, ::step]
    box = box_of(found.known, MARGIN)
    N = normalised(found.normals.map[::step, ::step][keep].astype(np.float64))
    T = _tangents(N)
    buffer = Buffer()
    mesh = {
        "attributes": {
            "POSITION": buffer.array(_positions(found, step).astype(np.float32), VERTICES, bounds=True),
            "NORMAL": buffer.array(N.astype(np.float32), VERTICES),
            "TANGENT": buffer.array(np.concatenate([T, np.ones((len(T), 1))], 1).astype(np.float32), VERTICES),
            "TEXCOORD_0": buffer.array(_coordinates(keep, step, box), VERTICES),
        },
        "indices": buffer.array(faces(keep).astype(np.uint32).reshape(-1, 1), INDICES),
    }
    grid = np.zeros((*keep.shape, 2, 3), np.float32)
    grid[keep] = np.stack([N, T], axis=1)
    return buffer.file(mesh, _material(found, buffer, box, spread(grid, keep), step))


def _positions(found: Relief, step: int) -> Float[np.ndarray, "v 3"]:
    X = vertices(Surface(found.surface.depth, found.known, found.surface.K), step)
    size = np.ptp(X, axis=0)
    unit = 1 / max(float(size.max()), 1e-9)
    if found.mm_per_px is not None:
        unit = scale_of(found.surface, found.mm_per_px) / 1000
    return (X - (X.min(0) + size / 2)) * unit


def _coordinates(keep: np.ndarray, step: int, box: tuple[slice, slice]) -> Float[np.ndarray, "v 2"]:
    """Where vertices lie in the pictures: x to the right, y down, from 0 to 1."""
    row, column = step * np.array(np.nonzero(keep))
    (top, bottom), (left, right) = ((side.start, side.stop) for side in box)
    return np.stack([(column + 0.5 - left) / (right - left), (row + 0.5 - top) / (bottom - top)], -1).astype(np.float32)


def _tangents(N: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    """Unit vectors along x, as far as they are normal to the normals."""
    T = np.stack([1 - N[:, 0] ** 2, -N[:, 0] * N[:, 1], -N[:, 0] * N[:, 2]], axis=-1)
    return normalised(np.where((T**2).sum(-1, keepdims=True) > 1e-12, T, [0.0, 0.0, 1.0]))


def _seen_from_frames(
    normals: Float[np.ndarray, "h w 3"], box: tuple[slice, slice], grid: Float[np.ndarray, "a b 2 3"], step: int
) -> Float[np.ndarray, "h w 3"]:
    """Normals of a box of pixels, reduced or not, in the frames that a renderer interpolates between the vertices."""
    rows, columns = (
        (side.start - 0.5 + (np.arange(n) + 0.5) * (side.stop - side.start) / n) / step
        for side, n in zip(box, normals.shape[:2], strict=True)
    )
    seen = np.empty_like(normals)
    for y, n in enumerate(normals):
        N, T = normalised(_between(grid, np.full(len(columns), rows[y]), columns)).swapaxes(0, 1)
        B = normalised(np.cross(N, T))
        c, t, b, z = ((u * v).sum(-1) for u, v in ((N, T), (n, T), (n, B), (n, N)))
        seen[y] = normalised(np.stack([(t - c * z) / (1 - c * c), b, (z - c * t) / (1 - c * c)], axis=-1))
    return seen


def _between(grid: np.ndarray, row: np.ndarray, column: np.ndarray) -> Float[np.ndarray, "p 3"]:
    """Values on a grid between its points, linear in the two triangles of each square, as `faces` parts it."""
    last = np.array(grid.shape[:2]) - 1
    r, c = (v.astype(int).clip(0, max(m - 1, 0)) for v, m in zip((row, column), last.tolist(), strict=True))
    below, beside = np.minimum(r + 1, last[0]), np.minimum(c + 1, last[1])
    y, x = ((v - i).clip(0, 1)[:, None, None] for v, i in zip((row, column), (r, c), strict=True))
    a, b, c_, d = grid[r, c], grid[r, beside], grid[below, c], grid[below, beside]
    return np.where(x + y <= 1, a + x * (b - a) + y * (c_ - a), d + (1 - x) * (c_ - d) + (1 - y) * (b - d))


def _material(found: Relief, buffer: Buffer, box: tuple[slice, slice], grid: np.ndarray, step: int) -> dict[str, Any]:
    layers = sheet(found, MARGIN)
    normals = _seen_from_frames(_fitting(layers.normals), box, grid, step)
    others = buffer.picture(encode_png(np.rint(255 * _fitting(layers.packed()).clip(0, 1)).astype(np.uint8)))
    rough: dict[str, Any] = {
        "baseColorTexture": buffer.picture(encode_png(display(_fitting(layers.colour)))),
        "metallicFactor": 0 if found.metalness is None else 1,
        "roughnessFactor": 1,
    }
    if found.roughness is not None or found.metalness is not None:
        rough["metallicRoughnessTexture"] = others
    return {
        "pbrMetallicRoughness": rough,
        "normalTexture": buffer.picture(encode_png(np.rint(127.5 * (normals + 1)).astype(np.uint8))),
        "occlusionTexture": others,
        "doubleSided": True,
    }


def _fitting(picture: np.ndarray) -> np.ndarray:
    """A picture whose sides a graphics card takes."""
    h, w = picture.shape[:2]
    scale = TEXTURE / max(h, w)
    size = max(1, round(scale * w)), max(1, round(scale * h))
    return picture if scale >= 1 else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
