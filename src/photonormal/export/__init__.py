"""Results -> files: normal maps, depth, meshes, pictures; the file's ending decides the format."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from photonormal.disk import Content, write
from photonormal.export.mesh import FACES
from photonormal.geometry import known_frame
from photonormal.types import InputError, Normals, Result, Surface, as_normals

LOG = logging.getLogger("photonormal")


def save(
    result: Normals | Surface | Result | np.ndarray,
    path: str | Path,
    normals: Normals | None = None,
    albedo: np.ndarray | None = None,
    frame: str = "opengl",
    mm_per_px: float | None = None,
    most_faces: int = FACES,
) -> Path:
    """Write normals or a surface to one file, or all of a measurement to a folder; whole or not at all.

    Parameters
    ----------
    result : Normals, or their map (h, w, 3), to ``.png`` (16-bit, (n + 1) / 2, green up, black outside), ``.exr`` or
        ``.npz``; a Surface to ``.npz``, as heights to ``.png``, ``.tif`` (16-bit) or ``.exr``, as a mesh to ``.ply``,
        ``.obj``, ``.glb`` or ``.stl``; a Result, of `photonormal.measure`, to a folder as the command writes it
    path : where; an existing file is replaced, a folder only if it holds nothing but a result
    normals : vertex normals of a mesh
    albedo : (h, w, 3) in [0, 1], linear: vertex colours of a mesh
    frame : of the normals in the file, a key of photonormal.geometry.FRAMES; a mesh keeps ours
    mm_per_px : width of a pixel (at the mean depth of a perspective view): depth, heights and meshes are in mm then
    most_faces : of a mesh, about; where every pixel for a vertex would make more, those of every second, third ... row
        and column are

    Returns
    -------
    The path written.
    """
    path = Path(path)
    if isinstance(result, Result):
        from photonormal.export.folder import whole_folder
        from photonormal.export.result import write_result

        with whole_folder(path) as folder:
            write_result(result, folder, frame)
        return path
    if not isinstance(result, Surface):
        result = as_normals(result)
    write(path, encoded(result, path.name, normals, albedo, frame, mm_per_px, most_faces))
    return path


def encoded(
    result: Normals | Surface,
    name: str,
    normals: Normals | None = None,
    albedo: np.ndarray | None = None,
    frame: str = "opengl",
    mm_per_px: float | None = None,
    most_faces: int = FACES,
    white: float = 1.0,
) -> Content:
    """The content of a file of that name, as `save` writes it; the albedo is 1 where it is `white`."""
    from photonormal.export import heights, mesh_files, normal_maps

    suffix = Path(name).suffix.lower()
    endings = normal_maps.WRITERS if isinstance(result, Normals) else (*heights.FORMATS, *mesh_files.FORMATS)
    if suffix not in endings:
        raise InputError(f"{name} ends in {suffix!r} but {', '.join(endings)} can be written; choose one of them.")
    if isinstance(result, Normals):
        known_frame(frame)
        return normal_maps.WRITERS[suffix](result, frame)
    if suffix in heights.FORMATS:
        return heights.encode(result, suffix, mm_per_px)
    return mesh_files.encode(result, suffix, normals, albedo, mm_per_px, most_faces, white)


def load_normals(
    path: str | Path,
    frame: str = "auto",
    channels: str = "auto",
    mask: np.ndarray | None = None,
    partial: bool = False,
    tell: Callable[[str], object] = LOG.info,
) -> Normals:
    """Normals from what `save` or `photonormal measure` wrote, or from a normal map that comes from elsewhere.

    Whatever has a direction is a normal. Black, white, mid-grey and transparent pixels are background.

    Parameters
    ----------
    path : ``.npz`` with `normals` and, if known, `mask`; a picture, 8 or 16-bit (n + 1) / 2, or floats that hold
        this or the vectors themselves; a ``.npy`` array (h, w, 3)
    frame : of the file, a key of photonormal.geometry.FRAMES; "auto": what the file says, else ours, unless the curl
        of the slopes or the sign of z say otherwise
    channels : which ones hold what: "xyz", "xy" (z is found), "wy" (x in alpha, y in green; z is found), or "auto":
        xyz where blue fits
    mask : (h, w) bool; pixels outside it have no normal
    partial : go on where less than 90 % of the pixels that are no background hold a normal
    tell : is called with a line for each thing found out about a picture

    Raises
    ------
    InputError
        If the file is no normal map, or it is unclear what its channels hold.
    """
    from photonormal.export import normal_maps

    if frame != normal_maps.AUTO:
        known_frame(frame)
    return normal_maps.read(Path(path), frame, channels, mask, partial, tell)
