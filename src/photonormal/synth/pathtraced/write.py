"""Writes rendered objects in the layouts of DiLiGenT and CyclesPS; a folder appears whole or not at all."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from photonormal.disk import at_once
from photonormal.png import encode_mask
from photonormal.synth.layout import RenderedObject, write_diligent
from photonormal.synth.pathtraced.tracer import eroded


def write_object(folder: Path, rendered: RenderedObject) -> None:
    """A DiLiGenT object."""
    with at_once(folder) as batch:
        write_diligent(batch, rendered)


def write_cyclesps(
    folder: Path,
    images: dict[str, np.ndarray],
    lights: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
) -> None:
    """A CyclesPS object: linear images (n, h, w, 3) of each kind of material, full scale 1."""
    with at_once(folder) as batch:
        for kind, stack in images.items():
            for j, image in enumerate(stack):
                values = np.round(image.clip(0, 1) * 65535).astype(np.uint16)
                batch.write(f"images_{kind}/{j:05d}.tif", _tiff(values))
        np.savetxt(batch / "light.txt", lights, "%.7f")
        coded = np.round((normals + 1) / 2 * 65535).astype(np.uint16)
        batch.write("gt_normal.tif", _tiff(coded))
        batch.write("inboundary.png", encode_mask(mask))
        batch.write("onboundary.png", encode_mask(mask & ~eroded(mask)))


def _tiff(picture: np.ndarray) -> bytes:
    """A TIFF file."""
    import tifffile

    encoded = io.BytesIO()
    tifffile.imwrite(encoded, picture, photometric="rgb")
    return encoded.getvalue()
