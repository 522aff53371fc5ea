"""Depth as arrays (NPZ) and heights as pictures (16-bit PNG and TIFF, float OpenEXR)."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from jaxtyping import Float

from photonormal.export.mesh import scale_of
from photonormal.export.normal_maps import encode_exr
from photonormal.files.opening import read_npz
from photonormal.png import encode_png, text
from photonormal.types import InputError, Surface

FORMATS = (".npz", ".png", ".tif", ".tiff", ".exr")


def encode(surface: Surface, suffix: str, mm_per_px: float | None) -> bytes | memoryview:
    """The bytes of depth (.npz), or of heights towards the camera as a picture: .exr holds them as they are, .png and
    .tif from the lowest (0) to the highest (65535); what lies outside the mask is as low as the lowest."""
    if suffix == ".npz":
        return depth_npz(surface, mm_per_px)
    z = heights_px(surface) * (1.0 if mm_per_px is None else mm_per_px)
    if not np.isfinite(z).any():
        raise InputError("the surface holds no depth; integrate normals that are known somewhere.")
    low, high = float(np.nanmin(z)), float(np.nanmax(z))
    z = np.nan_to_num(z, nan=low)
    if suffix == ".exr":
        return encode_exr({"Y": z})
    level = np.rint(65535 * (z - low) / ((high - low) or 1)).astype(np.uint16)
    said = f"from {low:.9g} to {high:.9g} {'px' if mm_per_px is None else 'mm'}"
    if suffix == ".png":
        return encode_png(level, text("photonormal-height", said))
    import tifffile

    buffer = io.BytesIO()
    tifffile.imwrite(buffer, level, photometric="minisblack", description=f"photonormal-height {said}")
    return buffer.getvalue()


def heights_px(surface: Surface) -> Float[np.ndarray, "h w"]:
    """Heights towards the camera in pixels, NaN where there is none; a perspective view's mean depth is at 0."""
    depth = np.where(surface.mask, surface.depth, np.nan)
    return depth if surface.K is None else (1 - depth) * surface.K[0, 0]


def depth_npz(surface: Surface, mm_per_px: float | None = None) -> memoryview:
    """`depth` float32 (h, w), NaN outside; `mask` bool (h, w); `K` (3, 3) of a perspective view; with `mm_per_px`,
    which is in the file then, depth is in millimetres."""
    buffer = io.BytesIO()
    about: dict[str, np.ndarray] = {} if surface.K is None else {"K": surface.K}
    if mm_per_px is not None:
        about["mm_per_px"] = np.array(mm_per_px)
    depth = (surface.depth * scale_of(surface, mm_per_px)).astype(np.float32)
    np.savez(buffer, allow_pickle=False, depth=depth, mask=surface.mask, **about)
    return buffer.getbuffer()


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
    found = Surface(data["depth"], data["mask"], data.get("K"))
    if "mm_per_px" not in data:
        return found
    unit = data["mm_per_px"]
    if unit.shape != () or not (np.isfinite(unit) and unit > 0):
        raise InputError(f"{path} holds mm_per_px {str(unit)[:40]} but one length above 0 is needed; integrate again.")
    return Surface(found.depth / scale_of(found, float(unit)), found.mask, found.K)
