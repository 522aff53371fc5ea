"""CyclesPS objects (Ikehata, ECCV 2018).

    sphere.obj/
        images_diffuse|images_specular|images_metallic/    00000.tif ..., 16-bit linear; the capture is one of them
        light.txt                                          x y z a line
        gt_normal.tif                                      16-bit, n = 2 v / 65535 - 1
        inboundary.png                                     mask

The layout of PS-Transformer's set is read too: `00000_direct.tif` beside `00000_indirect.tif` directly in the object's
folder; the direct part is read.
"""

from __future__ import annotations

from pathlib import Path

from photonormal.capture.assemble import Choice, assemble, natural
from photonormal.capture.images import decode, read_mask
from photonormal.capture.texts import read_directions
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for an object's folder and for one of its picture folders."""
    return path.is_dir() and (_object(path) / "light.txt").is_file() and (_object(path) / "gt_normal.tif").is_file()


def read(path: Path, choice: Choice) -> Capture:
    """The pictures of one rendering; an object's folder with several renderings is an error that lists them."""
    folder = _object(path)
    if path == folder:
        kinds = sorted(p for p in path.glob("images_*") if p.is_dir())
        if len(kinds) > 1:
            raise InputError(
                f"{path} has {len(kinds)} renderings but one is measured at a time; choose from "
                f"{', '.join(str(k) for k in kinds)}."
            )
        path = kinds[0] if kinds else path
    paths = sorted((p for p in path.glob("*.tif") if p.stem.removesuffix("_direct").isdigit()), key=natural)
    truth = decode(folder / "gt_normal.tif").astype(float) / 65535 * 2 - 1
    mask = folder / "inboundary.png"
    return assemble(
        name=f"{folder.resolve().name.removesuffix('.obj')} {path.name.removeprefix('images_')}".strip(),
        paths=paths,
        lights=read_directions(folder / "light.txt"),
        mask=read_mask(mask) if mask.exists() else None,
        truth=truth,
        choice=choice,
    )


def _object(path: Path) -> Path:
    return path.parent if path.name.startswith("images_") else path
