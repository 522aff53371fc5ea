"""Meshes as binary PLY, written some rows of the picture after the other: a whole one takes far more than its file."""

from __future__ import annotations

from collections.abc import Callable
from typing import BinaryIO

import numpy as np
from jaxtyping import Bool

from photonormal.export.mesh import display, faces, positions
from photonormal.types import Normals, Surface

VERTICES = 2**16  # made at a time, about
PROPERTIES = {  # what a vertex has -> kind of its numbers, and their names
    "position": ("<f4", ("float x", "float y", "float z")),
    "normal": ("<f4", ("float nx", "float ny", "float nz")),
    "colour": ("u1", ("uchar red", "uchar green", "uchar blue", "uchar alpha")),
}
FACE = np.dtype([("count", "u1"), ("index", "<i4", 3)])


def ply(
    surface: Surface,
    known: Bool[np.ndarray, "h w"],
    step: int,
    scale: float,
    normals: Normals | None,
    albedo: np.ndarray | None,
    white: float,
) -> Callable[[BinaryIO], None]:
    """What writes a mesh of every `step`-th row and column into an open file, as `mesh_files.encode` says."""
    keep = known[::step, ::step]
    has = [
        name for name, there in zip(PROPERTIES, (True, normals is not None, albedo is not None), strict=True) if there
    ]
    kind = np.dtype([(name, PROPERTIES[name][0], len(PROPERTIES[name][1])) for name in has])
    lines = max(1, VERTICES // keep.shape[1])
    bands = [slice(top, top + lines) for top in range(0, len(keep), lines)]

    def some_vertices(rows: slice) -> np.ndarray:
        row, column = np.nonzero(keep[rows])
        row, column = step * (row + rows.start), step * column
        found = np.empty(len(row), kind)
        depth = surface.depth[row, column]
        found["position"] = positions(row, column, depth, surface.mask.shape[0], surface.K) * scale
        if normals is not None:
            found["normal"] = normals.map[row, column]
        if albedo is not None:
            found["colour"][:, :3], found["colour"][:, 3] = display(albedo[row, column] / white), 255
        return found

    def some_faces(rows: slice, first: int) -> np.ndarray:
        index = faces(keep[rows.start : rows.stop + 1]) + first
        found = np.empty(len(index), FACE)
        found["count"], found["index"] = 3, index
        return found

    def write(file: BinaryIO) -> None:
        header = [f"element vertex {np.count_nonzero(keep)}"]
        header += [f"property {text}" for name in has for text in PROPERTIES[name][1]]
        header += [f"element face {face_count(keep)}", "property list uchar int vertex_indices", "end_header\n"]
        file.write("\n".join(["ply", "format binary_little_endian 1.0", *header]).encode())
        for rows in bands:
            file.write(some_vertices(rows).tobytes())
        first = 0
        for rows in bands:
            file.write(some_faces(rows, first).tobytes())
            first += int(np.count_nonzero(keep[rows]))

    return write


def face_count(keep: Bool[np.ndarray, "h w"]) -> int:
    """How many triangles `faces` makes: two where four neighbours are kept, one where three are."""
    kept = sum(part.astype(np.uint8) for part in (keep[:-1, :-1], keep[:-1, 1:], keep[1:, :-1], keep[1:, 1:]))
    return int(2 * np.count_nonzero(kept == 4) + np.count_nonzero(kept == 3))
