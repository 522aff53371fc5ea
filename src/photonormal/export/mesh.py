"""Depth as arrays and as triangle meshes with normals and colours (PLY, OBJ, GLB)."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from photonormal.files.opening import read_npz
from photonormal.types import InputError, Normals, Surface

FORMATS = (".npz", ".ply", ".obj", ".glb")


def depth_npz(surface: Surface) -> bytes:
    """`depth` float32 (h, w), NaN outside; `mask` bool (h, w); `K` (3, 3) of a perspective view."""
    buffer = io.BytesIO()
    camera = {} if surface.K is None else {"K": surface.K}
    np.savez(buffer, allow_pickle=False, depth=surface.depth.astype(np.float32), mask=surface.mask, **camera)
    return buffer.getvalue()


def read_depth(path: Path) -> Surface:
    """The surface in a `.npz` that `save` wrote.

    Raises
    ------
    InputError
        If the file is cut short or holds something else.
    """
    data = read_npz(path, "integrate the normals again", ("depth", "mask", "K"))
    if not {"depth", "mask"} <= data.keys():
        raise InputError(f"{path} holds {', '.join(data) or 'nothing'} but depth and mask are needed; integrate again.")
    return Surface(data["depth"], data["mask"], data.get("K"))


def vertices(surface: Surface) -> Float[np.ndarray, "v 3"]:
    """Positions of the mask's pixels, row by row: x right, y up, z to the camera.

    Orthographic: in pixels from the picture's lower left corner. Perspective: in the depth's unit from the camera.
    """
    row, column = np.nonzero(surface.mask)
    depth = surface.depth[surface.mask].astype(np.float64)
    if surface.K is None:
        return np.stack([column + 0.5, surface.mask.shape[0] - row - 0.5, depth], axis=-1)
    ray = np.linalg.solve(surface.K, np.stack([column, row, np.ones_like(row)]).astype(np.float64))  # x right, y down
    return (ray / ray[2] * depth * np.array([[1], [-1], [-1]])).T


def faces(mask: np.ndarray) -> Int[np.ndarray, "f 3"]:
    """Triangles between neighbouring pixels of the mask, facing the camera; indices of `vertices`."""
    index = np.full(mask.shape, -1, np.int64)
    index[mask] = np.arange(mask.sum())
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]  # upper left, upper right, lower ...
    triangles = []
    full = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    for corner, keep in (((a, c, b), full), ((b, c, d), full)):
        triangles.append(np.stack([k[keep] for k in corner], axis=-1))
    for missing, corner in ((a, (b, c, d)), (b, (a, c, d)), (c, (a, d, b)), (d, (a, c, b))):
        keep = (missing < 0) & (corner[0] >= 0) & (corner[1] >= 0) & (corner[2] >= 0)
        triangles.append(np.stack([k[keep] for k in corner], axis=-1))
    return np.concatenate(triangles)


def encode(surface: Surface, suffix: str, normals: Normals | None, albedo: np.ndarray | None) -> bytes:
    """The bytes of depth (.npz) or of a mesh; a mesh leaves out pixels without depth."""
    if suffix == ".npz":
        return depth_npz(surface)
    import trimesh

    keep = surface.mask & np.isfinite(surface.depth)
    if not keep.any():
        raise InputError("the surface holds no depth; integrate normals that are known somewhere.")
    surface = Surface(surface.depth, keep, surface.K)
    mesh = trimesh.Trimesh(
        vertices(surface),
        faces(keep),
        vertex_normals=None if normals is None else normals.map[keep].astype(np.float64),
        vertex_colors=None if albedo is None else display(albedo)[keep],
        process=False,
        validate=False,
    )
    buffer = io.BytesIO()
    mesh.export(buffer, file_type=suffix[1:])
    return buffer.getvalue()


def display(linear: np.ndarray) -> np.ndarray:
    """8-bit sRGB from linear values; what is above 1 is white."""
    x = np.nan_to_num(linear).clip(0, 1)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded).astype(np.uint8)
