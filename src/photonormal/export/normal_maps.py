"""Normal maps as files. Frame: x right is red, y up is green (OpenGL), z to the camera is blue."""

from __future__ import annotations

import io
import os
import tempfile
from pathlib import Path

import numpy as np

from photonormal.files.decode import decode, full_scale
from photonormal.files.opening import read_npz
from photonormal.png import encode_png
from photonormal.types import InputError, Normals


def png(normals: Normals) -> bytes:
    """16-bit RGB, (n + 1) / 2; black outside the mask."""
    value = np.rint((normals.map + 1) * 32767.5).astype(np.uint16)
    value[~normals.mask] = 0
    return encode_png(value)


def exr(normals: Normals) -> bytes:
    """32-bit float RGB, the vectors themselves."""
    import OpenEXR

    with tempfile.TemporaryDirectory() as folder:  # the library writes to file names only
        file = str(Path(folder) / "normals.exr")
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGB": np.ascontiguousarray(normals.map)}) as image:
            image.write(file)
        return Path(file).read_bytes()


def npz(normals: Normals) -> bytes:
    """`normals` float32 (h, w, 3), `mask` bool (h, w) and, where known, `expected_error_deg` float32 (h, w)."""
    arrays = {"normals": normals.map, "mask": normals.mask}
    if normals.expected_error_deg is not None:
        arrays["expected_error_deg"] = normals.expected_error_deg
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


WRITERS = {".png": png, ".exr": exr, ".npz": npz}


def read(path: Path) -> Normals:
    """Normals from a file of WRITERS' kinds, or from the `normals.npz` of a result folder."""
    if path.is_dir():
        if not os.path.lexists(path / "normals.npz"):
            raise InputError(f"{path} holds no normals.npz; give a folder that `photonormal measure` wrote.")
        path = path / "normals.npz"
    if not os.path.lexists(path):
        raise InputError(f"{path} does not exist; give normals as .npz, .png or .exr.")
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise InputError(f"{path} ends in {suffix!r} but normals are read from {', '.join(WRITERS)}.")
    if suffix == ".npz":
        return _read_npz(path)
    map = decode(path)
    if map.shape[2] != 3:
        raise InputError(f"{path} is no colour picture; a normal map stores (n + 1) / 2 as red, green, blue.")
    if suffix == ".png":
        map = map / (full_scale(map) / 2) - 1
    length = np.linalg.norm(map, axis=-1)
    known = np.abs(length - 1) < 0.1  # black and mid-grey backgrounds are far from unit length
    if not known.any():
        raise InputError(f"{path} holds no unit vectors; a normal map stores (n + 1) / 2 as red, green, blue.")
    unit = np.zeros(map.shape, np.float32)
    unit[known] = map[known] / length[known][:, None]
    return Normals(unit, known)


def _read_npz(path: Path) -> Normals:
    arrays = read_npz(path, "save them again", ("normals", "mask", "expected_error_deg"))
    if not {"normals", "mask"} <= arrays.keys():
        raise InputError(f"{path} holds {', '.join(arrays) or 'nothing'} but normals and mask are needed; save both.")
    return Normals(arrays["normals"], arrays["mask"], arrays.get("expected_error_deg"))
