"""A result as glTF 2.0: its mesh, and the pictures of what lies on it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from jaxtyping import Float

from photonormal.disk import at_once
from photonormal.export.mesh import FACES, display, faces, positions, scale_of, step_for
from photonormal.files.memory import scratch_folder
from photonormal.geometry import normalised
from photonormal.handover.glb import INDICES, VERTICES, Buffer
from photonormal.handover.opened import refuse
from photonormal.handover.sheets import Layers, nearest, sheet
from photonormal.handover.surfaces import Part, Relief, textured_relief
from photonormal.masked import box_of
from photonormal.png import PngRows
from photonormal.progress import progress
from photonormal.types import InputError, Surface

TEXTURE = 8192  # pixels of a picture's side at most, unless said: what nearly every graphics card takes
SMALLEST, LARGEST = 16, 16384  # that can be asked for; the second is what large graphics cards take
MARGIN = 8  # pixels around the object in its pictures


def export_gltf(
    result: Path,
    out: Path,
    mm_per_px: float | None = None,
    overwrite: bool = False,
    texture: int = TEXTURE,
) -> tuple[Path, float]:
    """Write a result as one .glb file: mesh with tangents, base colour, normal map, occlusion.

    The mesh lies around the origin, y up, z to the camera; in metres where the width of a pixel is known, else its
    longer side is 1. Roughness and metalness are written where the result has them. Pictures are made some rows at a
    time; it returns the file, and how much smaller than the result they are, 1 where they are not.

    Parameters
    ----------
    result : a folder that `measure` wrote
    out : the file to write
    mm_per_px : millimetres that a pixel is wide, where the report does not say
    overwrite : replace a file that exists
    texture : pixels of a picture's side at most, SMALLEST to LARGEST

    Raises
    ------
    InputError
        If the folder is no result with depth and albedo, it has no triangle, or the file can't be written.
    """
    if not SMALLEST <= texture <= LARGEST:
        raise InputError(f"--texture {texture} came but {SMALLEST} to {LARGEST} pixels are needed; choose so many.")
    refuse("gltf", result, out, overwrite)
    with (
        textured_relief(result, mm_per_px) as found,
        at_once(out.parent) as batch,
        (batch / out.name).open("wb") as file,
    ):
        file.writelines(encoded(found, texture=texture))
        longest = max(side.stop - side.start for side in box_of(found.known, MARGIN))
    return out, max(1.0, longest / texture)


def encoded(found: Relief, most_faces: int = FACES, texture: int = TEXTURE) -> Iterator[bytes]:
    """The pieces of the file, one after the other."""
    step = step_for(found.known, most_faces)
    box = box_of(found.known, MARGIN)
    some = found.part(slice(0, None, step), slice(0, None, step))
    keep = some.known
    corners = faces(keep).astype(np.uint32)
    if not len(corners):
        raise InputError(
            "the object is too narrow for a mesh, of which the format needs one triangle at least; choose --to maps."
        )
    N = normalised(some.normals[keep].astype(np.float64))
    T = _tangents(N)
    buffer = Buffer()
    mesh = {
        "attributes": {
            "POSITION": buffer.array(_positions(found, some, step).astype(np.float32), VERTICES, bounds=True),
            "NORMAL": buffer.array(N.astype(np.float32), VERTICES),
            "TANGENT": buffer.array(np.concatenate([T, np.ones((len(T), 1))], 1).astype(np.float32), VERTICES),
            "TEXCOORD_0": buffer.array(_coordinates(keep, step, box), VERTICES),
        },
        "indices": buffer.array(corners.reshape(-1, 1), INDICES),
    }
    grid = np.zeros((*keep.shape, 2, 3), np.float32)
    grid[keep] = np.stack([N, T], axis=1)
    row, column = nearest(keep)[0]
    with ExitStack() as kept:
        layers = sheet(found, MARGIN).reduced(texture)
        material = _material(layers, buffer, _Frames(grid[row, column], step, box, layers.size), kept)
        yield from buffer.file(mesh, material)


def _positions(found: Relief, some: Part, step: int) -> Float[np.ndarray, "v 3"]:
    row, column = step * np.array(np.nonzero(some.known))
    X = positions(row, column, some.depth[some.known], len(found.known), found.K)
    size = np.ptp(X, axis=0)
    unit = 1 / max(float(size.max()), 1e-9)
    if found.mm_per_px is not None:
        unit = scale_of(Surface(some.depth, some.known, found.K), found.mm_per_px) / 1000
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


class _Frames:
    """The frames that a renderer interpolates between the vertices of the mesh.

    Parameters
    ----------
    grid : (a, b, 2, 3) normals and tangents at the vertices
    step : pixels between them
    box : which pixels of the result the pictures show, in how many rows and columns: `size`
    """

    def __init__(
        self, grid: Float[np.ndarray, "a b 2 3"], step: int, box: tuple[slice, slice], size: tuple[int, int]
    ) -> None:
        self.grid = grid
        self.rows, self.columns = (
            (side.start - 0.5 + (np.arange(n) + 0.5) * (side.stop - side.start) / n) / step
            for side, n in zip(box, size, strict=True)
        )

    def __call__(self, normals: Float[np.ndarray, "h w 3"], rows: slice) -> Float[np.ndarray, "h w 3"]:
        """Normals of some rows of the pictures, reduced or not, as these frames show them."""
        seen = np.empty_like(normals)
        for y, (n, row) in enumerate(zip(normals, self.rows[rows], strict=True)):
            N, T = normalised(_between(self.grid, np.full(len(n), row), self.columns)).swapaxes(0, 1)
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


def _material(layers: Layers, buffer: Buffer, frames: _Frames, kept: ExitStack) -> dict[str, Any]:
    files = [cast(BinaryIO, kept.enter_context(tempfile.TemporaryFile(dir=scratch_folder()))) for _ in range(3)]
    pictures = [PngRows(file, layers.size, np.uint8, colour=True) for file in files]
    rough = metal = False
    with progress("pictures", layers.size[0]) as advance:
        for rows, part in layers.parts():
            rough, metal = part.roughness is not None, part.metalness is not None
            shown = (
                display(part.colour),
                np.rint(127.5 * (frames(part.normals, rows) + 1)).astype(np.uint8),
                np.rint(255 * part.packed().clip(0, 1)).astype(np.uint8),
            )
            for picture, samples in zip(pictures, shown, strict=True):
                picture.write(samples)
            advance(rows.stop - rows.start)
    for picture in pictures:
        picture.close()
    colour, normals, others = (buffer.picture(file) for file in files)
    known = {"metallicRoughnessTexture": others} if rough or metal else {}
    return {
        "pbrMetallicRoughness": {
            "baseColorTexture": colour,
            "metallicFactor": 1 if metal else 0,
            "roughnessFactor": 1,
            **known,
        },
        "normalTexture": normals,
        "occlusionTexture": others,
        "doubleSided": True,
    }
