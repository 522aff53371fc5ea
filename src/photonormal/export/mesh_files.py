"""Meshes as files with normals and colours (PLY, OBJ, GLB, STL)."""

from __future__ import annotations

import io

import numpy as np
from jaxtyping import Float, Int

from photonormal.disk import Content
from photonormal.export.mesh import coordinates, display, faces, scale_of, step_for, vertices
from photonormal.export.ply import ply
from photonormal.types import InputError, Normals, Surface

FORMATS = (".ply", ".obj", ".glb", ".stl")
BLOCK = 2**16  # rows that become text at a time


def encode(
    surface: Surface,
    suffix: str,
    normals: Normals | None,
    albedo: np.ndarray | None,
    mm_per_px: float | None,
    most_faces: int,
    white: float,
) -> Content:
    """The content of a mesh; it leaves out pixels without depth.

    Every pixel is a vertex; where that makes more than about `most_faces` triangles, those of every second, third ...
    row and column are.

    Every kind but .stl holds vertex normals, and colours where `albedo` is given, over `white`: sRGB, linear in .glb as
    glTF wants them. .obj and .glb hold the picture's coordinates, too: 0, 0 is its lower left corner, 1, 1 its upper
    right one.
    """
    known = surface.mask & np.isfinite(surface.depth)
    if not known.any():
        raise InputError("the surface holds no depth; integrate normals that are known somewhere.")
    step = step_for(surface.mask, most_faces)
    scale = scale_of(surface, mm_per_px)
    if suffix == ".ply":
        return ply(surface, known, step, scale, normals, albedo, white)
    some = np.s_[::step, ::step]
    keep = known[some]
    points = vertices(Surface(surface.depth, known, surface.K), step) * scale
    N = None if normals is None else normals.map[some][keep].astype(np.float64)
    linear = None if albedo is None else np.broadcast_to(albedo[some][keep] / white, (len(points), 3))
    if suffix == ".obj":
        return _obj(points, faces(keep), N, None if linear is None else display(linear) / 255, coordinates(known, step))
    import trimesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    mesh = trimesh.Trimesh(points, faces(keep), vertex_normals=N, process=False, validate=False)
    if suffix == ".glb":
        mesh.visual = look = TextureVisuals(coordinates(known, step), PBRMaterial())
        if linear is not None:
            look.vertex_attributes["color"] = _with_alpha(np.rint(255 * np.nan_to_num(linear).clip(0, 1)))
    buffer = io.BytesIO()
    mesh.export(buffer, file_type=suffix[1:])
    return buffer.getbuffer()


def _obj(
    points: Float[np.ndarray, "v 3"],
    triangles: Int[np.ndarray, "f 3"],
    normals: Float[np.ndarray, "v 3"] | None,
    colours: Float[np.ndarray, "v 3"] | None,
    uv: Float[np.ndarray, "v 2"],
) -> bytes:
    """Wavefront OBJ with colours behind the positions, as MeshLab and Blender read them."""
    rows = points if colours is None else np.concatenate([points, colours], axis=1)
    parts = [_lines("v" + " %.6g" * rows.shape[1], rows), _lines("vt %.6g %.6g", uv)]
    corner = "%d/%d"
    if normals is not None:
        parts.append(_lines("vn %.5g %.5g %.5g", normals))
        corner = "%d/%d/%d"
    parts.append(_lines(f"f {corner} {corner} {corner}", np.repeat(triangles + 1, corner.count("d"), axis=1)))
    return "".join(parts).encode()


def _lines(form: str, rows: np.ndarray) -> str:
    """Each row by the form; in blocks, since numbers take ten times their size while they become text."""
    blocks = (rows[k : k + BLOCK] for k in range(0, len(rows), BLOCK))
    return "".join(((form + "\n") * len(block)) % tuple(block.ravel().tolist()) for block in blocks)


def _with_alpha(colours: np.ndarray) -> np.ndarray:
    return np.concatenate([colours, np.full((len(colours), 1), 255)], axis=1).astype(np.uint8)
