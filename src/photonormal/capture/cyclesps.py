"""CyclesPS objects (Ikehata, ECCV 2018).

    sphere.obj/
        images_diffuse|images_specular|images_metallic/    00000.tif ..., 16-bit linear; the capture is one of them
        light.txt                                          x y z a line
        gt_normal.tif                                      16-bit, n = 2 v / 65535 - 1
        inboundary.png                                     mask

The layout of PS-Transformer's set is read too: `00000_direct.tif` and `00000_indirect.tif` directly in the object's
folder; a picture is their sum, the light that came straight and the light that surfaces passed on.
"""

from __future__ import annotations

import os
from pathlib import Path

from photonormal.capture.assemble import Choice, assemble, coded_normals
from photonormal.capture.lights import read_lights
from photonormal.capture.pictures import natural
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for an object's folder and for one of its picture folders."""
    return all(os.path.isfile(_object(path) / name) for name in ("light.txt", "gt_normal.tif"))


def read(path: Path, choice: Choice) -> Capture:
    """The pictures of one rendering; an object's folder with several renderings is an error that lists them."""
    path = path.resolve()
    folder = _object(path)
    if path == folder:
        kinds = sorted(p for p in path.glob("images_*") if p.is_dir())
        if len(kinds) > 1:
            raise InputError(
                f"{path} has {len(kinds)} renderings but one is measured at a time; choose from "
                f"{', '.join(str(k) for k in kinds)}."
            )
        path = kinds[0] if kinds else path
    direct = sorted(path.glob("*_direct.tif"), key=lambda p: natural(p.name))
    whole = sorted((p for p in path.glob("*.tif") if p.stem.isdecimal()), key=lambda p: natural(p.name))
    mask = folder / "inboundary.png"
    kind = path.name.removeprefix("images_") if path != folder else ""
    return assemble(
        name=f"{folder.name.removesuffix('.obj')} {kind}".strip(),
        pictures=[(p, p.with_name(p.name.replace("_direct", "_indirect"))) for p in direct] or whole,
        lights=read_lights(folder / "light.txt"),
        mask=mask if os.path.lexists(mask) else None,
        truth=lambda frame: coded_normals(folder / "gt_normal.tif", frame),
        choice=choice,
    )


def _object(path: Path) -> Path:
    path = path.resolve()
    return path.parent if path.name.startswith("images_") else path
