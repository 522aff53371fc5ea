"""Scenes whose normals are known exactly, for tests."""

from __future__ import annotations

import numpy as np

from photonormal.types import Capture, Normals


def ring(n: int, elevation_deg: float = 60.0) -> np.ndarray:
    """`n` lights on a circle around the view axis, and one along it: (n + 1, 3)."""
    phi, e = 2 * np.pi * np.arange(n) / n, np.radians(elevation_deg)
    around = np.stack([np.cos(phi) * np.cos(e), np.sin(phi) * np.cos(e), np.full(n, np.sin(e))], axis=-1)
    return np.concatenate([around, [[0, 0, 1]]])


def sphere(size: int = 48, rim: float = 0.95) -> Normals:
    """A sphere seen whole; normals nearer to the silhouette than `rim` of its radius are left out."""
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size]
    r2 = (x**2 + y**2) / 0.9**2
    mask = r2 < rim**2
    map = np.stack([x / 0.9, y / 0.9, np.sqrt(np.maximum(1 - r2, 0))], axis=-1)
    return Normals(np.where(mask[..., None], map, 0).astype(np.float32), mask)


def lambertian(truth: Normals, lights: np.ndarray, albedo: float = 0.7) -> Capture:
    """Photographs of a matt surface, attached shadows included."""
    images = albedo * np.maximum(np.einsum("hwc,nc->nhw", truth.map, lights), 0)[..., None]
    return Capture(images.astype(np.float32), truth.mask, lights, truth=truth, name="sphere")


def write_diligent(folder, capture: Capture) -> None:
    """The capture's pictures as a DiLiGenT object, 16-bit, lights of intensity 1."""
    import cv2
    from scipy.io import savemat

    folder.mkdir(parents=True, exist_ok=True)
    n, _, _, c = capture.images.shape
    names = [f"{j + 1:03d}.png" for j in range(n)]
    for j, name in enumerate(names):
        picture = np.rint(65535 * np.clip(capture.images[j], 0, 1)).astype(np.uint16)
        picture = np.repeat(picture, 3, axis=-1) if c == 1 else picture[..., ::-1]
        cv2.imencode(".png", picture)[1].tofile(folder / name)
    (folder / "filenames.txt").write_text("\n".join(names) + "\n")
    np.savetxt(folder / "light_directions.txt", capture.lights, fmt="%.8f")
    np.savetxt(folder / "light_intensities.txt", np.ones((n, 3)))
    cv2.imencode(".png", capture.mask.astype(np.uint8) * 255)[1].tofile(folder / "mask.png")
    if capture.truth is not None:
        savemat(folder / "Normal_gt.mat", {"Normal_gt": capture.truth.map.astype(float)})
