"""Normal maps as files: x right is red, y up is green (OpenGL), z to the camera is blue, or as the file says."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from photonormal.disk import Content, recover
from photonormal.export import foreign
from photonormal.export.foreign import AUTO
from photonormal.files.decode import KINDS, decode_all
from photonormal.files.matlab import read_mat, shapes_of
from photonormal.files.opening import read_npz
from photonormal.files.remarks import remark
from photonormal.geometry import FRAMES, from_frame, in_frame, known_frame
from photonormal.png import by_rows, text
from photonormal.types import InputError, Normals, in_pixels

FRAME = "photonormal-frame"  # the remark in a file that says the frame of its normals


def png(normals: Normals, frame: str) -> Content:
    """16-bit RGB, (n + 1) / 2; black outside the mask."""

    def rows(some: slice) -> np.ndarray:
        level = np.rint((in_frame(normals.map[some], frame) + 1) * 32767.5) * normals.mask[some, :, None]
        return level.astype(np.uint16)

    return by_rows(rows, normals.mask.shape, np.uint16, text(FRAME, frame))


def exr(normals: Normals, frame: str) -> bytes:
    """32-bit float RGB, the vectors themselves."""
    return encode_exr({"RGB": in_frame(normals.map, frame)}, {FRAME: frame})


def encode_exr(channels: dict[str, np.ndarray], header: dict[str, str] | None = None) -> bytes:
    """OpenEXR of float channels by their names, with attributes."""
    import OpenEXR

    with tempfile.TemporaryDirectory() as folder:  # the library writes to file names only
        file = str(Path(folder) / "picture.exr")
        about = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **(header or {})}
        pixels = {name: np.ascontiguousarray(channel, np.float32) for name, channel in channels.items()}
        with OpenEXR.File(about, pixels) as image:
            image.write(file)
        return Path(file).read_bytes()


def npz(normals: Normals, frame: str) -> Content:
    """`normals` float32 (h, w, 3), `mask` bool (h, w) and, where known, `expected_error_deg` float32 (h, w); `axes`,
    the frame's as photonormal.geometry.FRAMES has them, where it is not ours."""
    arrays = {"normals": normals.map, "mask": normals.mask}
    if normals.expected_error_deg is not None:
        arrays["expected_error_deg"] = normals.expected_error_deg
    if frame != "opengl":
        arrays["normals"] = in_frame(normals.map, frame)
        arrays["axes"] = np.array(FRAMES[frame], np.int8)
    return partial(np.savez, allow_pickle=False, **arrays)  # type: ignore[arg-type]


WRITERS = {".png": png, ".exr": exr, ".npz": npz}
READ = (*KINDS, ".npz", ".mat")
MAT_NAMES = ("Normal_gt", "normals", "Normals", "normal", "N")  # of arrays in .mat files, where several could be it


def read(
    path: Path,
    frame: str,
    channels: str,
    mask: Bool[np.ndarray, "h w"] | None,
    partial: bool,
    tell: Callable[[str], object],
) -> Normals:
    """Normals from a file of one of the endings READ, or from the `normals.npz` of a result folder; in our frame.

    `tell` gets what is worth knowing of a file that is read; one that is refused says nothing but why.
    """
    notes: list[str] = []
    if channels not in foreign.CHANNELS:
        raise InputError(f"no channels {channels[:40]!r}; choose from {', '.join(foreign.CHANNELS)}.")
    if path.is_dir():
        recover(path)
        if not os.path.lexists(path / "normals.npz"):
            raise InputError(f"{path} holds no normals.npz; give a folder that `photonormal measure` wrote.")
        path = path / "normals.npz"
    if not os.path.lexists(path):
        raise InputError(f"{path} does not exist; give normals as .npz, .png, .exr or another picture.")
    suffix = path.suffix.lower()
    if suffix not in READ:
        raise InputError(f"{path} ends in {suffix!r} but normals are read from {', '.join(READ)}.")
    if suffix == ".npz":
        samples, named, ours = _arrays(path)
    elif suffix == ".mat":
        samples, named, ours = _of_matlab(path), None, None
    else:
        samples, named, ours = decode_all(path, finite=False), remark(path, FRAME), None
    if named is not None and frame not in (AUTO, named):
        notes.append(
            f"{path}: the file says that its frame is {named}, but it is read as --frame {frame} nevertheless."
        )
    if named is not None and frame == AUTO:
        known_frame(named)
        frame = named
    if mask is not None and mask.shape != samples.shape[:2]:
        raise InputError(
            f"the mask has {in_pixels(mask.shape)} but {path} {in_pixels(samples.shape)}; give one of its size."
        )
    if ours is None:
        found = foreign.judged(samples, path, frame, channels, mask, partial, notes.append)
    else:
        kept = ours.mask if mask is None else ours.mask & mask
        values = ours.map if frame == AUTO else from_frame(ours.map, frame)
        found = Normals(values, kept, ours.expected_error_deg)
    for note in notes:
        tell(note)
    return found


def _of_matlab(path: Path) -> np.ndarray:
    """The one array (h, w, 3) of a .mat file, or that of MAT_NAMES; whole numbers up to 255 or 65535 are codes."""
    found = {name: shape for name, shape in shapes_of(path).items() if len(shape) == 3 and shape[2] == 3}
    name = next((name for name in (*MAT_NAMES, *found) if name in found), None)
    if name is None or (len(found) > 1 and name not in MAT_NAMES):
        raise InputError(
            f"{path} holds {len(found)} arrays (h, w, 3) but one with normals is needed; save it as Normal_gt."
        )
    values = read_mat(path, name)
    if np.nanmax(values, initial=0) > 1.5 and np.array_equal(values, np.rint(values).clip(0, 65535)):
        return values.astype(np.uint8 if values.max() < 256 else np.uint16)
    return values.astype(np.float32)


def _arrays(path: Path) -> tuple[np.ndarray, str | None, Normals | None]:
    """The vectors of an .npz file, its frame where it has one, and the normals as stored where their mask is there."""
    arrays = read_npz(path, "save them again", ("normals", "mask", "expected_error_deg", "axes"))
    if "normals" not in arrays:
        raise InputError(f"{path} holds {', '.join(arrays) or 'no normals'} but normals are needed; save them so.")
    frame = told_frame(arrays.get("axes"), path)
    ours = Normals(arrays["normals"], arrays["mask"], arrays.get("expected_error_deg")) if "mask" in arrays else None
    if arrays["normals"].ndim != 3 or arrays["normals"].shape[2] != 3:
        raise InputError(f"the normals in {path} are {arrays['normals'].shape} but (h, w, 3) is needed; save them so.")
    return arrays["normals"], frame, ours


def told_frame(axes: np.ndarray | None, path: Path) -> str | None:
    """The frame of the `axes` that an .npz file says; None where it has none."""
    if axes is None:
        return None
    for name, known in FRAMES.items():
        if list(known) == axes.tolist():
            return name
    raise InputError(f"{path} names axes {str(axes.tolist())[:60]}, which are no known frame; save it again.")
