"""Depth as arrays (NPZ) and heights as pictures (16-bit PNG and TIFF, float OpenEXR)."""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt16

from photonormal.disk import Content
from photonormal.export.mesh import scale_of
from photonormal.export.normal_maps import encode_exr
from photonormal.files.opening import read_npz
from photonormal.png import encode_png, text
from photonormal.types import InputError, Surface

REMARK = "photonormal-height"  # in a file, which says what black and white are
FORMATS = (".npz", ".png", ".tif", ".tiff", ".exr")


def encode(surface: Surface, suffix: str, mm_per_px: float | None) -> Content:
    """The content of depth (.npz), or of heights towards the camera as a picture: .exr holds them as they are, .png and
    .tif from the lowest (0) to the highest (65535); what lies outside the mask is as low as the lowest."""
    if suffix == ".npz":
        return depth_npz(surface, mm_per_px)
    z = surface.heights_px() * (1.0 if mm_per_px is None else mm_per_px)
    if not np.isfinite(z).any():
        raise InputError("the surface holds no depth; integrate normals that are known somewhere.")
    low, high = float(np.nanmin(z)), float(np.nanmax(z))
    if suffix == ".exr":
        return encode_exr({"Y": np.nan_to_num(z, nan=low)})
    level, said = levels(z, low, high), span(low, high, mm_per_px)
    if suffix == ".png":
        return encode_png(level, text(REMARK, said))
    import tifffile

    buffer = io.BytesIO()
    tifffile.imwrite(buffer, level, photometric="minisblack", description=f"{REMARK} {said}")
    return buffer.getvalue()


def levels(z: Float[np.ndarray, "h w"], low: float, high: float) -> UInt16[np.ndarray, "h w"]:
    """Heights in 16 bits, 0 at `low` and 65535 at `high`; NaN is as low as the lowest."""
    return np.rint(65535 * (np.nan_to_num(z, nan=low) - low) / ((high - low) or 1)).astype(np.uint16)


def span(low: float, high: float, mm_per_px: float | None) -> str:
    """What such a picture says of its levels."""
    return f"from {low:.9g} to {high:.9g} {'px' if mm_per_px is None else 'mm'}"


def depth_npz(surface: Surface, mm_per_px: float | None) -> Content:
    """`depth` float32 (h, w), NaN outside; `mask` bool (h, w); `K` (3, 3) of a perspective view; with `mm_per_px`,
    which is in the file then, depth is in millimetres."""
    about: dict[str, np.ndarray] = {} if surface.K is None else {"K": surface.K}
    if mm_per_px is not None:
        about["mm_per_px"] = np.array(mm_per_px)
    depth = np.empty(surface.depth.shape, np.float32)
    np.multiply(surface.depth, scale_of(surface, mm_per_px), out=depth, casting="same_kind")
    return partial(np.savez, allow_pickle=False, depth=depth, mask=surface.mask, **about)


def read_depth(path: Path) -> Surface:
    """The surface in a `.npz` that `save` wrote, in the units of a Surface.

    Raises
    ------
    InputError
        If the file is cut short or holds something else.
    """
    data = read_npz(path, "integrate the normals again", ("depth", "mask", "K", "mm_per_px"))
    if not {"depth", "mask"} <= data.keys():
        raise InputError(f"{path} holds {', '.join(data) or 'nothing'} but depth and mask are needed; integrate again.")
    return in_own_units(Surface(data["depth"], data["mask"], data.get("K")), data.get("mm_per_px"), path)


def in_own_units(found: Surface, unit: np.ndarray | None, path: Path) -> Surface:
    """A surface as a Surface has it, of one in millimetres, a pixel being `unit` wide; None: it is one."""
    if unit is None:
        return found
    if unit.shape != () or not (np.isfinite(unit) and unit > 0):
        raise InputError(f"{path} holds mm_per_px {str(unit)[:40]} but one length above 0 is needed; integrate again.")
    return Surface(found.depth / scale_of(found, float(unit)), found.mask, found.K)
