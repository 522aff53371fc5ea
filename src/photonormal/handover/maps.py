"""A result as pictures for materials, named as 3D programs look for them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.disk import at_once
from photonormal.export import encoded
from photonormal.export.mesh import display
from photonormal.handover.opened import refuse
from photonormal.handover.sheets import Sheet, repeating, sheet
from photonormal.handover.surfaces import relief
from photonormal.png import SRGB, encode_png
from photonormal.types import InputError, Normals, Surface


@dataclass(frozen=True)
class Program:
    """What a program expects: the frame of its normal maps, and names by layer, in which {} is the texture's."""

    frame: str
    names: dict[str, str]


PLAIN = {
    "colour": "{}_BaseColor.png",
    "normals": "{}_Normal.png",
    "height": "{}_Height.png",
    "occlusion": "{}_AmbientOcclusion.png",
    "roughness": "{}_Roughness.png",
    "metalness": "{}_Metallic.png",
}
UNREAL = {"colour": "T_{}_BC.png", "normals": "T_{}_N.png", "height": "T_{}_H.png", "packed": "T_{}_ORM.png"}
PROGRAMS = {
    "blender": Program("opengl", PLAIN),
    "substance": Program("directx", PLAIN),
    "unreal": Program("directx", UNREAL),
}


def export_maps(
    result: Path,
    out: Path,
    program: str = "blender",
    tile: bool = False,
    mm_per_px: float | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a folder of pictures that share its name, cut to the object, and NAME.json, which tells what they mean.

    Base colour is sRGB in 8 bits, normals and height have 16, from the lowest to the highest; occlusion, roughness and
    metalness, the last two where the result has them, are linear in 8.

    Parameters
    ----------
    result : a folder that `measure` wrote
    out : the folder to write
    program : a key of PROGRAMS
    tile : the pictures repeat, see `photonormal.handover.sheets.repeating`
    mm_per_px : millimetres that a pixel is wide, where the report does not say
    overwrite : write into a folder that holds other files

    Raises
    ------
    InputError
        If there is no such program, the folder is no result with depth and albedo, or the object can be no tile.
    """
    if program not in PROGRAMS:
        raise InputError(f"--program {program[:40]!r} came but {', '.join(PROGRAMS)} are known; choose one.")
    refuse("maps", out, overwrite, [result])
    found = relief(result, mm_per_px)
    layers = sheet(found)
    if tile:
        layers = repeating(layers, result)
    expected, name, unit = PROGRAMS[program], out.resolve().name, found.mm_per_px
    h, w = layers.height.shape
    scale = 1.0 if unit is None else unit
    told = {
        "normals": expected.frame,
        "height": {"low": float(np.nanmin(layers.height) * scale), "high": float(np.nanmax(layers.height) * scale)},
        "width": w * scale,
        "length": h * scale,
        "unit": "px" if unit is None else "mm",
        "repeats": tile,
    }
    encoders = _encoders(layers, expected.frame, unit)
    with at_once(out) as batch:
        for layer, pattern in expected.names.items():
            data = encoders[layer]()
            if data is not None:
                batch.write(pattern.format(name), data)
        batch.write(f"{name}.json", (json.dumps(told, indent=2) + "\n").encode())
    return out


def _encoders(layers: Sheet, frame: str, unit: float | None) -> dict[str, Callable[[], bytes | memoryview | None]]:
    """The bytes of each layer's picture, None where it is unknown."""
    everywhere = np.ones(layers.height.shape, bool)
    return {
        "colour": lambda: encode_png(display(layers.colour), SRGB),
        "normals": lambda: encoded(Normals(layers.normals, everywhere), "normals.png", frame=frame),
        "height": lambda: encoded(Surface(layers.height, np.isfinite(layers.height)), "height.png", mm_per_px=unit),
        "occlusion": lambda: _linear(layers.occlusion),
        "roughness": lambda: _linear(layers.roughness),
        "metalness": lambda: _linear(layers.metalness),
        "packed": lambda: _linear(layers.packed()),
    }


def _linear(values: np.ndarray | None) -> bytes | None:
    return None if values is None else encode_png(np.rint(255 * values.clip(0, 1)).astype(np.uint8))
