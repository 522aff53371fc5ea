"""Normal maps as files. Frame: x right is red, y up is green (OpenGL), z to the camera is blue."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

import numpy as np

from photonormal.stored import read_arrays
from photonormal.types import InputError, Normals


def encode_png(picture: np.ndarray) -> bytes:
    """PNG of (h, w) or (h, w, 3) RGB samples, 8 or 16-bit, as they are."""
    import cv2

    bgr = picture[..., ::-1] if picture.ndim == 3 else picture
    return cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()


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
        if not (path / "normals.npz").is_file():
            raise InputError(f"{path} holds no normals.npz; give a folder that `photonormal measure` wrote.")
        path = path / "normals.npz"
    if not path.is_file():
        raise InputError(f"{path} does not exist; give normals as .npz, .png or .exr.")
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise InputError(f"{path} ends in {suffix!r} but normals are read from {', '.join(WRITERS)}.")
    try:
        if suffix == ".npz":
            data = read_arrays(path, "save them again")
            return Normals(data["normals"], data["mask"], data.get("expected_error_deg"))
        map = _read_exr(path) if suffix == ".exr" else _read_png(path)
    except InputError:
        raise
    except Exception as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"{path} can't be read as normals ({reason}); save them again.") from None
    length = np.linalg.norm(map, axis=-1)
    known = np.abs(length - 1) < 0.1  # black and mid-grey backgrounds are far from unit length
    if not known.any():
        raise InputError(f"{path} holds no unit vectors; a normal map stores (n + 1) / 2 as red, green, blue.")
    unit = np.zeros(map.shape, np.float32)
    unit[known] = map[known] / length[known][:, None]
    return Normals(unit, known)


def _read_png(path: Path) -> np.ndarray:
    import cv2

    value = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
    if value is None or value.ndim != 3 or value.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path} is no 8 or 16-bit colour PNG; a normal map stores (n + 1) / 2 as red, green, blue.")
    return value[..., 2::-1] / (np.iinfo(value.dtype).max / 2) - 1


def _read_exr(path: Path) -> np.ndarray:
    import OpenEXR

    with OpenEXR.File(str(path)) as image:
        channels = image.channels()
        name = next((n for n in ("RGB", "RGBA") if n in channels), None)
        if name is None:
            raise InputError(f"{path} has channels {', '.join(channels)} but R, G and B are needed.")
        return np.array(channels[name].pixels[..., :3], np.float32)
