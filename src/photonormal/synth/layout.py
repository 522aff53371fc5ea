"""Writes rendered captures in published layouts, which `photonormal.load` reads."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from photonormal.disk import FileBatch, Inside


class RenderedObject(NamedTuple):
    """Linear images of an object, radiance over intensity, of which 1 is the brightest light's full scale."""

    images: Float[np.ndarray, "n h w 3"]
    lights: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]


def write_diligent(
    folder: FileBatch | Inside,
    rendered: RenderedObject,
    intensities: Float[np.ndarray, "n 3"] | None = None,
    bits: int = 16,
) -> None:
    """A DiLiGenT object: 16-bit pictures of radiance times intensity, lists, mask and ``Normal_gt.mat``.

    `bits` below 16 leaves the lowest ones of each 16-bit sample zero, as a camera of fewer bits does.
    """
    import cv2
    from scipy.io import savemat

    images, lights, normals, mask = rendered
    n = len(images)
    if intensities is None:
        intensities = np.ones((n, 3))
    names = [f"{j + 1:03d}.png" for j in range(n)]
    step = 2 ** (16 - bits)
    for j, name in enumerate(names):
        values = images[j] * (intensities[j] / intensities.max())
        values = np.round(values.clip(0, 1) * (65535 // step)) * step * mask[..., None]
        _write(folder / name, cv2.cvtColor(values.astype(np.uint16), cv2.COLOR_RGB2BGR))
    (folder / "filenames.txt").write_text("".join(f"{name}\n" for name in names))
    np.savetxt(folder / "light_directions.txt", lights, "%.7f")
    np.savetxt(folder / "light_intensities.txt", intensities / intensities.max(), "%.7f")
    _write(folder / "mask.png", mask.astype(np.uint8) * 255)
    savemat(folder / "Normal_gt.mat", {"Normal_gt": normals.astype(np.float32)}, do_compression=True)


class BlobbyWriter:
    """A Blobby or Sculpture set (Chen et al., ECCV 2018), sample by sample.

    train_mtrl.txt, val_mtrl.txt    lines `shape/material`
    Images/shape/
        shape_normal.png            8-bit, n = 2 v / 255 - 1, background 127
        material/                   8-bit linear pictures, named after their light
            shape_material.txt      lines `picture lx ly lz`
    """

    def __init__(self, root: FileBatch, validation_every: int = 100) -> None:
        self.root, self.every, self.count = root, validation_every, 0
        for name in ("train_mtrl.txt", "val_mtrl.txt"):
            (root / name).touch()

    def write(self, shape: str, material: str, rendered: RenderedObject) -> None:
        """Add one sample; the last of each hundred goes to the validation list."""
        import cv2

        images, lights, normals, mask = rendered
        around = self.root.inside(f"Images/{shape}")
        folder = around.inside(material)
        coded = np.where(mask[..., None], np.round((normals + 1) / 2 * 255), 127).astype(np.uint8)
        _write(around / f"{shape}_normal.png", cv2.cvtColor(coded, cv2.COLOR_RGB2BGR))
        lines = []
        for j, (image, l) in enumerate(zip(images, lights, strict=True)):
            name = f"{shape}_{material}_{j:03d}_l_{l[0]:.2f},{l[1]:.2f},{l[2]:.2f}.png"
            values = np.round(image.clip(0, 1) * 255).astype(np.uint8)
            _write(folder / name, cv2.cvtColor(values, cv2.COLOR_RGB2BGR))
            lines.append(f"{name} {l[0]:.6f} {l[1]:.6f} {l[2]:.6f}\n")
        (folder / f"{shape}_{material}.txt").write_text("".join(lines))
        self.count += 1
        split = "val_mtrl.txt" if self.count % self.every == 0 else "train_mtrl.txt"
        with (self.root / split).open("a") as file:
            file.write(f"{shape}/{material}\n")


def _write(path: Path, picture: np.ndarray) -> None:
    import cv2

    path.write_bytes(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes())
