"""A result as pictures for materials, named as 3D programs look for them."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.disk import FileBatch, at_once
from photonormal.export.heights import REMARK, levels, span
from photonormal.export.mesh import display
from photonormal.export.normal_maps import FRAME
from photonormal.files.exr import ExrRows
from photonormal.geometry import in_frame
from photonormal.handover.opened import refuse
from photonormal.handover.sheets import Layers, Sheet, sheet
from photonormal.handover.surfaces import textured_relief
from photonormal.handover.tiles import repeating
from photonormal.png import SRGB, PngRows, text
from photonormal.progress import progress
from photonormal.types import InputError

FLOATS = {"colour": True, "normals": False, "height": False}  # layers that --exr writes so; whether in 16 bits


@dataclass(frozen=True)
class TargetProgram:
    """What a program expects: the frame of its normal maps, and names by layer, in which {} is the texture's."""

    frame: str
    names: dict[str, str]


PLAIN = {
    "colour": "{}_BaseColor",
    "normals": "{}_Normal",
    "height": "{}_Height",
    "occlusion": "{}_AmbientOcclusion",
    "roughness": "{}_Roughness",
    "metalness": "{}_Metallic",
}
UNREAL = {"colour": "T_{}_BC", "normals": "T_{}_N", "height": "T_{}_H", "packed": "T_{}_ORM"}
PROGRAMS = {
    "blender": TargetProgram("opengl", PLAIN),
    "substance": TargetProgram("directx", PLAIN),
    "unreal": TargetProgram("directx", UNREAL),
}


def export_maps(
    result: Path,
    out: Path,
    program: str = "blender",
    tile: bool = False,
    mm_per_px: float | None = None,
    overwrite: bool = False,
    exr: bool = False,
) -> Path:
    """Write a folder of pictures that share its name, cut to the object, and NAME.json, which shows what they mean.

    Base colour is sRGB in 8 bits, normals and height have 16, from the lowest to the highest; occlusion, roughness and
    metalness, the last two where the result has them, are linear in 8. They are made some rows at a time.

    Parameters
    ----------
    result : a folder that `measure` wrote
    out : the folder to write
    program : a key of PROGRAMS
    tile : the pictures repeat, see `photonormal.handover.tiles.repeating`
    mm_per_px : millimetres that a pixel is wide, where the report does not say
    overwrite : write into a folder that holds other files
    exr : base colour, normals and height are OpenEXR: linear floats of 16 and 32 bits, normals (n + 1) / 2 as in the
        other pictures, heights as they are

    Raises
    ------
    InputError
        If there is no such program, the folder is no result with depth and albedo, or the object can be no tile.
    """
    if program not in PROGRAMS:
        raise InputError(f"--program {program[:40]!r} came but {', '.join(PROGRAMS)} are known; choose one.")
    refuse("maps", result, out, overwrite)
    with ExitStack() as kept:
        found = kept.enter_context(textured_relief(result, mm_per_px))
        layers = sheet(found)
        if tile:
            layers = kept.enter_context(repeating(layers, result))
        expected, name, unit = PROGRAMS[program], out.resolve().name, found.mm_per_px
        low, high = (value * (unit or 1.0) for value in layers.heights)
        h, w = layers.size
        facts = {
            "normals": expected.frame,
            "height": {"low": low, "high": high},
            "width": w * (unit or 1.0),
            "length": h * (unit or 1.0),
            "unit": "px" if unit is None else "mm",
            "repeats": tile,
        }
        batch = kept.enter_context(at_once(out))
        _write(layers, expected, name, unit, exr, batch)
        batch.write(f"{name}.json", (json.dumps(facts, indent=2) + "\n").encode())
    return out


def _write(layers: Layers, expected: TargetProgram, name: str, unit: float | None, exr: bool, batch: FileBatch) -> None:
    """All pictures at the same time, some rows after the other."""
    values = _values(layers, expected.frame, unit, exr)
    low, high = (value * (unit or 1.0) for value in layers.heights)
    remarks = {
        "colour": SRGB,
        "normals": text(FRAME, expected.frame),
        "height": text(REMARK, span(low, high, unit)),
    }
    pictures: dict[str, PngRows | ExrRows] = {}
    with ExitStack() as files, progress("pictures", layers.size[0]) as advance:
        for rows, part in layers.parts():
            for layer, pattern in expected.names.items():
                picture = values[layer](part)
                if picture is None:
                    continue
                if layer not in pictures:
                    path = batch / (pattern.format(name) + (".exr" if exr and layer in FLOATS else ".png"))
                    colour = picture.ndim == 3
                    if path.suffix == ".exr":
                        pictures[layer] = ExrRows(path, layers.size, colour, half=FLOATS[layer])
                    else:
                        file = files.enter_context(path.open("wb"))
                        pictures[layer] = PngRows(file, layers.size, picture.dtype, colour, remarks.get(layer))
                pictures[layer].write(picture)
            advance(rows.stop - rows.start)
        for picture in pictures.values():
            picture.close()


def _values(
    layers: Layers, frame: str, unit: float | None, exr: bool
) -> dict[str, Callable[[Sheet], np.ndarray | None]]:
    """The samples of each layer's picture, None where it is unknown."""
    (low, high), mm = layers.heights, np.float32(unit or 1.0)
    pictures: dict[str, Callable[[Sheet], np.ndarray | None]] = {
        "colour": lambda part: display(part.colour),
        "normals": lambda part: np.rint((in_frame(part.normals, frame) + 1) * 32767.5).astype(np.uint16),
        "height": lambda part: levels(part.height, low, high),
        "occlusion": lambda part: _in_8_bits(part.occlusion),
        "roughness": lambda part: _in_8_bits(part.roughness),
        "metalness": lambda part: _in_8_bits(part.metalness),
        "packed": lambda part: _in_8_bits(part.packed()),
    }
    floats: dict[str, Callable[[Sheet], np.ndarray | None]] = {
        "colour": lambda part: part.colour,
        "normals": lambda part: (in_frame(part.normals, frame) + 1) / 2,
        "height": lambda part: np.nan_to_num(part.height, nan=low) * mm,
    }
    return pictures | floats if exr else pictures


def _in_8_bits(values: np.ndarray | None) -> np.ndarray | None:
    return None if values is None else np.rint(255 * values.clip(0, 1)).astype(np.uint8)
