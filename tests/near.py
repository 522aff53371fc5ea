"""Matt surfaces under near lamps, exactly shaded, for tests."""

from __future__ import annotations

import numpy as np

from photonormal.geometry import normalised
from photonormal.types import Camera, Capture, Lamps, Normals

ORTHOGRAPHIC = Camera(mm_per_px=1.0)
PERSPECTIVE = Camera(mm_per_px=1.0, K=np.array([[160.0, 0, 23.5], [0, 160, 25], [0, 0, 1]]))


def bump(camera: Camera, size: int) -> tuple[np.ndarray, Normals]:
    """Points (h, w, 3) mm and normals of a smooth hill whose mean depth the camera's scale holds for.

    It is a fifth of its width high; normals are exact.
    """
    far = camera.points_mm(np.full((size, size), np.nan))  # on the mean plane
    width = size / 4

    def hill(x, y):
        return size / 5 * np.exp(-(x**2 + y**2) / (2 * width**2))

    X = far.copy()
    base, offset = far[..., 2], 0.0
    for _ in range(200):  # z = base + hill(x, y) - offset along each pixel's ray, and the offset of the mean
        z = base + hill(X[..., 0], X[..., 1]) - offset
        X = far + (z - base)[..., None] * [0, 0, 1] if camera.K is None else far * (z / base)[..., None]
        offset += float((X[..., 2] - base).mean())
    h = hill(X[..., 0], X[..., 1])
    N = normalised(np.stack([X[..., 0] * h / width**2, X[..., 1] * h / width**2, np.ones_like(h)], -1))
    return X, Normals(N.astype(np.float32), np.ones((size, size), bool))


def dome(n: int, radius_mm: float, centre: np.ndarray) -> np.ndarray:
    """`n` positions on a ring and one above: (n, 3) mm around `centre`."""
    phi = 2 * np.pi * np.arange(n - 1) / (n - 1)
    e = np.radians(np.where(np.arange(n - 1) % 2, 45, 65))
    around = np.stack([np.cos(phi) * np.cos(e), np.sin(phi) * np.cos(e), np.sin(e)], -1)
    return centre + radius_mm * np.concatenate([around, [[0, 0, 1]]])


def photographed(
    camera: Camera, lamps: Lamps, X: np.ndarray, truth: Normals, albedo: float | np.ndarray = 0.5
) -> Capture:
    """Photographs of the points; written out anew, without the library's shading."""
    r0 = np.linalg.norm(lamps.positions_mm - camera.flat_mm(truth.mask).mean(0), axis=-1).mean()
    images = []
    for S, axis, mu in zip(lamps.positions_mm, lamps.axes, lamps.mu, strict=True):
        d = S - X
        r = np.linalg.norm(d, axis=-1)
        l = d / r[..., None]
        cos = np.clip(-(l * axis).sum(-1), 0, None)
        images.append(albedo * (r0 / r) ** 2 * cos**mu * np.clip((truth.map * l).sum(-1), 0, None))
    return Capture(np.stack(images)[..., None].astype(np.float32), truth.mask, lamps=lamps, camera=camera, truth=truth)
