"""Results -> files: normal maps, depth, meshes, pictures; the file's ending decides the format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from photonormal.geometry import in_frame
from photonormal.types import InputError, Normals, Surface


def save(
    result: Normals | Surface,
    path: str | Path,
    normals: Normals | None = None,
    albedo: np.ndarray | None = None,
    frame: str = "opengl",
) -> Path:
    """Write normals or a surface to one file; whole or not at all.

    Parameters
    ----------
    result : Normals to ``.png`` (16-bit, (n + 1) / 2, green up, black outside), ``.exr`` or ``.npz``; a Surface to
        ``.npz`` or, as a mesh, to ``.ply``, ``.obj`` or ``.glb``
    path : where; an existing file is replaced
    normals : vertex normals of a mesh
    albedo : (h, w, 3) in [0, 1], linear: vertex colours of a mesh
    frame : of the normals in the file, a key of photonormal.geometry.FRAMES; a mesh keeps ours

    Returns
    -------
    The path written.
    """
    from photonormal.disk import write

    path = Path(path)
    write(path, encoded(result, path.name, normals, albedo, frame))
    return path


def encoded(
    result: Normals | Surface,
    name: str,
    normals: Normals | None = None,
    albedo: np.ndarray | None = None,
    frame: str = "opengl",
) -> bytes:
    """The bytes of a file of that name, as `save` writes it."""
    from photonormal.export import mesh, normal_maps

    suffix = Path(name).suffix.lower()
    endings = normal_maps.WRITERS if isinstance(result, Normals) else mesh.FORMATS
    if suffix not in endings:
        raise InputError(f"{name} ends in {suffix!r} but {', '.join(endings)} can be written; choose one of them.")
    if isinstance(result, Normals):
        return normal_maps.WRITERS[suffix](replace(result, map=in_frame(result.map, frame)))
    return mesh.encode(result, suffix, normals, albedo)


def load_normals(path: str | Path, frame: str = "opengl") -> Normals:
    """Normals that `save` wrote, or any normal map of the same frame: ``.npz``, ``.png`` or ``.exr``; or a folder that
    `photonormal measure` wrote. `frame` is that of the file, a key of photonormal.geometry.FRAMES.
    """
    from photonormal.export import normal_maps

    found = normal_maps.read(Path(path))
    return replace(found, map=in_frame(found.map, frame))
