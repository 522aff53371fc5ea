"""A result's surface and what lies on it, as 3D programs take them; some rows at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from photonormal.export.heights import in_own_units
from photonormal.export.normal_maps import told_frame
from photonormal.export.pictures import albedo_samples, is_encoded, linear
from photonormal.files import memory
from photonormal.files.decode import decode, full_scale
from photonormal.files.opening import read_npz
from photonormal.files.rows import Rows, npz_rows
from photonormal.geometry import from_frame
from photonormal.types import InputError, Normals, Surface
from photonormal.view.result import mm_per_px_of, report_of

MATERIAL = ("roughness.png", "metalness.png")
BASE = "base_colour.png"  # in place of the albedo, where materials were measured
PIXELS = 2**21  # made at a time at most,
HELD = 400  # bytes of one of them while that is done,
SHARE = 4  # in this part of the memory


@dataclass(frozen=True)
class Part:
    """Some pixels of a result.

    Parameters
    ----------
    known : (h, w) bool, with depth and a normal; the values of others mean nothing
    normals : (h, w, 3) x right, y up, z to the camera
    depth : (h, w) as a Surface has it, and height : (h, w) towards the camera in pixels
    albedo : (h, w, 3) linear, from 0 to 1
    roughness, metalness : (h, w) from 0 to 1, None where the result has none; rough where nothing is known
    """

    known: Bool[np.ndarray, "h w"]
    normals: Float[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]
    height: Float[np.ndarray, "h w"]
    albedo: Float[np.ndarray, "h w 3"]
    roughness: Float[np.ndarray, "h w"] | None
    metalness: Float[np.ndarray, "h w"] | None


@dataclass(frozen=True)
class Relief:
    """A result whose depth is known. Only `known` is held, the rest lies in scratch files.

    Parameters
    ----------
    known : (h, w) bool, pixels with depth and a normal
    heights : the lowest and the highest of them, pixels
    K : (3, 3) camera matrix of a perspective view, or None
    mm_per_px : millimetres that a pixel is wide, None where that is unknown
    layers : by name
    encoded : the colours are sRGB-encoded
    """

    known: Bool[np.ndarray, "h w"]
    heights: tuple[float, float]
    K: np.ndarray | None
    mm_per_px: float | None
    layers: dict[str, Rows]
    encoded: bool

    def part(self, rows: slice, columns: slice) -> Part:
        """Some rows and columns, also every second, third ... of them."""
        known = self.known[rows, columns]
        normals, depth, colour = (self.layers[name][rows][:, columns] for name in ("normals", "depth", "colour"))
        height = Surface(depth, known, self.K).heights_px()
        rough, metal = (self._level(name, rows, columns) for name in MATERIAL)
        if rough is not None:
            rough = np.where(rough > 0, rough, np.float32(1))
        return Part(known, normals, depth, height, linear(colour, self.encoded), rough, metal)

    def _level(self, name: str, rows: slice, columns: slice) -> np.ndarray | None:
        if name not in self.layers:
            return None
        samples = self.layers[name][rows][:, columns, 0]
        return samples / np.float32(full_scale(samples))


def picture_rows(h: int, w: int) -> Iterator[slice]:
    """Rows of a picture, as many at a time as `photonormal.files.memory` allows."""
    rows = max(1, min(PIXELS, memory.allowed() // (SHARE * HELD)) // max(1, w))
    for y in range(0, h, rows):
        yield slice(y, min(y + rows, h))


@contextmanager
def textured_relief(result: Path, mm_per_px: float | None = None) -> Iterator[Relief]:
    """A result's `normals.npz` and `depth.npz`, its `base_colour.png`, else `albedo.png`, and where it has them
    `roughness.png`, whose 0 means unknown, and `metalness.png`.

    Raises
    ------
    InputError
        If the folder holds no result, no depth or no albedo, or a file of another size.
    """
    report = report_of(result)
    for name in ("depth.npz", "albedo.png"):
        if not (result / name).is_file():
            raise InputError(f"{result} holds no {name}, which a surface needs; measure again without --no-mesh.")
    with ExitStack() as kept:
        layers: dict[str, Rows] = {}
        for name in ("normals", "depth"):
            found = kept.enter_context(npz_rows(result / f"{name}.npz", "measure again", (name, "mask")))
            if found.keys() != {name, "mask"}:
                raise InputError(f"{result / name}.npz holds no {name} and mask; measure again.")
            layers |= {name: found[name], f"{name} mask": found["mask"]}
        measured = (result / BASE).is_file()
        colours = result / (BASE if measured else "albedo.png")
        samples = decode(colours) if measured else albedo_samples(colours)
        encoded = is_encoded(colours, samples)
        layers["colour"] = kept.enter_context(_stored(samples))
        del samples
        for name in MATERIAL:
            if (result / name).is_file():
                layers[name] = kept.enter_context(_stored(decode(result / name)))
        frame = layers["normals mask"].shape
        for name, layer in layers.items():
            if layer.shape[:2] != frame:
                files = {"normals": "normals.npz", "depth": "depth.npz", "depth mask": "depth.npz"}
                file = files.get(name, colours.name if name == "colour" else name)
                raise InputError(
                    f"{result / file} is {layer.shape[:2]} but normals.npz beside it is {frame}; measure again."
                )
        known, heights, K = _checked(result, layers)
        unit = mm_per_px_of(report, result) if mm_per_px is None else mm_per_px
        yield Relief(known, heights, K, unit, layers, encoded)


def _stored(samples: np.ndarray) -> Rows:
    rows = Rows(samples.shape, samples.dtype)
    rows[:] = samples
    return rows


def _checked(result: Path, layers: dict[str, Rows]) -> tuple[np.ndarray, tuple[float, float], np.ndarray | None]:
    """Which pixels have depth and a normal, their lowest and highest, and the camera's matrix.

    Normals and depth are put into our frame and units.
    """
    about = read_npz(result / "depth.npz", "measure again", ("K", "mm_per_px"))
    frame = told_frame(read_npz(result / "normals.npz", "measure again", ("axes",)).get("axes"), result / "normals.npz")
    h, w = layers["normals mask"].shape
    K = about.get("K")
    known, low, high = np.zeros((h, w), bool), np.inf, -np.inf
    for rows in picture_rows(h, w):
        normals = Normals(layers["normals"][rows], layers["normals mask"][rows])
        surface = Surface(layers["depth"][rows], layers["depth mask"][rows], K)
        if frame is not None:
            layers["normals"][rows] = from_frame(normals.map, frame)
        surface = in_own_units(surface, about.get("mm_per_px"), result / "depth.npz")
        if "mm_per_px" in about:
            layers["depth"][rows] = surface.depth
        known[rows] = surface.mask & np.isfinite(surface.depth) & normals.mask
        heights = surface.heights_px()[known[rows]]
        if heights.size:
            low, high = min(low, float(heights.min())), max(high, float(heights.max()))
    if not known.any():
        raise InputError(f"{result} holds no depth where it has normals; measure again.")
    return known, (low, high), K
