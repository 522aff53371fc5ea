"""A result's surface and what lies on it, as 3D programs take them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from photonormal.export import load_normals
from photonormal.export.heights import read_depth
from photonormal.export.pictures import read_albedo, read_colours
from photonormal.files.decode import decode, full_scale
from photonormal.types import InputError, Normals, Surface
from photonormal.view.result import mm_per_px_of, report_of

MATERIAL = ("roughness.png", "metalness.png")
BASE = "base_colour.png"  # in place of the albedo, where materials were measured


@dataclass(frozen=True)
class Relief:
    """A result whose depth is known.

    Parameters
    ----------
    normals, surface : of the whole frame
    albedo : (h, w, 3) linear, from 0 to 1
    roughness, metalness : (h, w) from 0 to 1, None where the result has none; rough where nothing is known
    mm_per_px : millimetres that a pixel is wide, None where that is unknown
    """

    normals: Normals
    surface: Surface
    albedo: Float[np.ndarray, "h w 3"]
    roughness: Float[np.ndarray, "h w"] | None
    metalness: Float[np.ndarray, "h w"] | None
    mm_per_px: float | None

    @property
    def known(self) -> np.ndarray:
        """(h, w) bool: pixels with depth and a normal."""
        return self.surface.mask & np.isfinite(self.surface.depth) & self.normals.mask


def relief(result: Path, mm_per_px: float | None = None) -> Relief:
    """Read a result; `base_colour.png`, `roughness.png`, whose 0 means unknown, and `metalness.png` where it has them.

    Raises
    ------
    InputError
        If the folder holds no result, no depth or no albedo, or a file of another size.
    """
    report = report_of(result)
    normals = load_normals(result)
    for name in ("depth.npz", "albedo.png"):
        if not (result / name).is_file():
            raise InputError(f"{result} holds no {name}, which a surface needs; measure again without --no-mesh.")
    surface, base = read_depth(result / "depth.npz"), result / BASE
    albedo = read_colours(base, normals.mask.shape) if base.is_file() else read_albedo(result / "albedo.png")
    roughness, metalness = (_layer(result / name) for name in MATERIAL)
    frame = normals.mask.shape
    names = ("depth.npz", "albedo.png", *MATERIAL)
    for name, found in zip(names, (surface.depth, albedo, roughness, metalness), strict=True):
        if found is not None and found.shape[:2] != frame:
            raise InputError(
                f"{result / name} is {found.shape[:2]} but normals.npz beside it is {frame}; measure again."
            )
    if roughness is not None:
        roughness = np.where(roughness > 0, roughness, np.float32(1))
    unit = mm_per_px_of(report, result) if mm_per_px is None else mm_per_px
    found = Relief(normals, surface, albedo, roughness, metalness, unit)
    if not found.known.any():
        raise InputError(f"{result} holds no depth where it has normals; measure again.")
    return found


def _layer(path: Path) -> Float[np.ndarray, "h w"] | None:
    if not path.is_file():
        return None
    samples = decode(path)
    return samples[..., 0] / np.float32(full_scale(samples))
