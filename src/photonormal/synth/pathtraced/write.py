"""Writes rendered objects in the layouts of DiLiGenT and CyclesPS; a folder appears whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from photonormal.synth.layout import write_diligent
from photonormal.synth.pathtraced.tracer import eroded


def write_object(
    folder: Path,
    images: Float[np.ndarray, "n h w 3"],
    lights: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
) -> None:
    """A DiLiGenT object of linear images whose full scale is 1."""
    with _whole(folder) as part:
        write_diligent(part, images, lights, normals, mask)


def write_cyclesps(
    folder: Path,
    images: dict[str, np.ndarray],
    lights: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
) -> None:
    """A CyclesPS object: linear images (n, h, w, 3) of each kind of material, full scale 1."""
    import tifffile

    with _whole(folder) as part:
        for kind, stack in images.items():
            (part / f"images_{kind}").mkdir(parents=True)
            for j, image in enumerate(stack):
                values = np.round(image.clip(0, 1) * 65535).astype(np.uint16)
                tifffile.imwrite(part / f"images_{kind}" / f"{j:05d}.tif", values, photometric="rgb")
        np.savetxt(part / "light.txt", lights, "%.7f")
        coded = np.round((normals + 1) / 2 * 65535).astype(np.uint16)
        tifffile.imwrite(part / "gt_normal.tif", coded, photometric="rgb")
        _write_mask(part / "inboundary.png", mask)
        _write_mask(part / "onboundary.png", mask & ~eroded(mask))


def _write_mask(path: Path, mask: Bool[np.ndarray, "h w"]) -> None:
    import cv2

    cv2.imwrite(str(path), mask.astype(np.uint8) * 255)


@contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """A folder beside the one that is wanted, which takes its place when the block ends well."""
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        yield part
        shutil.rmtree(folder, ignore_errors=True)
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
