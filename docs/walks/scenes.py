"""The captures of the walks, rendered: a clay tablet under an RTI dome, a cloth and a mirror sphere under eight lamps.

    python docs/walks/scenes.py FOLDER

writes FOLDER/tablet, FOLDER/cloth and FOLDER/sphere.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import torch

from photonormal.export.lights import lp
from photonormal.synth.shadows import distant

EMPTY = -1000.0  # height in pixels of where there is nothing


def dome(count: int, widest_deg: float) -> np.ndarray:
    """Lights (count, 3), evenly over a cap around the camera."""
    k = np.arange(count) + 0.5
    theta, phi = np.radians(widest_deg) * np.sqrt(k / count), k * np.pi * (1 + 5**0.5)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def ring(count: int, elevation_deg: float) -> np.ndarray:
    """Lights (count, 3) around the camera's axis, the first from the right."""
    phi, e = 2 * np.pi * np.arange(count) / count, np.radians(elevation_deg)
    return np.stack([np.cos(phi) * np.cos(e), np.sin(phi) * np.cos(e), np.full(count, np.sin(e))], axis=-1)


def photographs(height: np.ndarray, albedo: np.ndarray, lights: np.ndarray, gloss: float) -> np.ndarray:
    """Linear pictures (n, s, s, 3) of heights (s, s) in pixels, EMPTY outside, with shadows and a highlight."""
    inside = height > EMPTY
    slope_y, slope_x = np.gradient(np.where(inside, height, 0))
    N = np.stack([-slope_x, slope_y, np.ones_like(height)], axis=-1)
    N /= np.linalg.norm(N, axis=-1, keepdims=True)
    s, L = len(height), torch.tensor(lights, dtype=torch.float32)[None]
    solid = torch.full((1, 3, s, s), EMPTY)
    solid[0, 0] = torch.tensor(height)
    pixels = torch.arange(s * s, dtype=torch.int32)[None]
    normals = torch.tensor(N.reshape(-1, 3).T[None], dtype=torch.float32)
    reached = distant(solid, L, pixels, normals)[0].numpy().reshape(-1, s, s)  # (n, s, s)
    half = lights + np.array([0, 0, 1])
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    lambert = np.maximum(np.einsum("ijk,nk->nij", N, lights), 0) * reached
    glint = gloss * np.maximum(np.einsum("ijk,nk->nij", N, half), 0) ** 24 * (lambert > 0) * reached
    picture = albedo * lambert[..., None] + glint[..., None] + 0.01 * albedo
    return np.where(inside[..., None], picture, 0.004)


def tablet_height(s: int, seed: int = 3) -> np.ndarray:
    """A clay tablet with rows of wedges."""
    v, u = np.mgrid[-1 : 1 : 1j * s, -1 : 1 : 1j * s]
    g = np.random.default_rng(seed)
    a, b = np.abs(u / 0.66), np.abs(v / 0.88)
    pillow = (1 - a**5).clip(0) * (1 - b**7).clip(0)
    height = 0.09 * s * np.sqrt(pillow) + 0.004 * s * np.sin(3 * u + 1) * np.cos(2.2 * v)
    depth = np.zeros((s, s))
    for row in np.linspace(-0.7, 0.7, 8):
        for column in np.arange(-0.52, 0.54, 0.15):
            for _ in range(g.integers(1, 4)):
                x, y = column + g.uniform(-0.03, 0.06), row + g.uniform(-0.04, 0.04)
                turn = g.choice([0.0, np.pi / 2, np.pi / 4])
                along = (u - x) * np.cos(turn) + (v - y) * np.sin(turn)
                across = -(u - x) * np.sin(turn) + (v - y) * np.cos(turn)
                taper = (1 - along / 0.13) * (along > -0.004)
                wedge = taper - np.abs(across) / 0.03 * (0.4 + 0.6 * (along > 0.0))
                depth = np.maximum(depth, 0.011 * s * wedge.clip(0, 1))
    grain = cv2.GaussianBlur(g.standard_normal((s, s)), (0, 0), s / 220) * 0.0035 * s / 3
    return np.where(pillow > 0.02, height - depth + grain, EMPTY)


def cloth_height(s: int) -> np.ndarray:
    """A cloth in folds, woven."""
    v, u = np.mgrid[-1 : 1 : 1j * s, -1 : 1 : 1j * s]
    angle, far = np.arctan2(v + 1.3, u + 0.4), np.hypot(u + 0.4, v + 1.3)
    folds = far**0.5 * np.sin(9 * angle + 1.3 * np.sin(2.2 * far)) + 0.6 * np.sin(4.2 * far - 3 * angle)
    folds += 0.35 * np.sin(6 * u - 4 * v) * np.cos(5 * v + 2 * u)
    weave = np.sin(np.pi * s / 5 * u) * np.sin(np.pi * s / 5 * v)
    return 0.035 * s * folds + 0.12 * weave


def tablet(folder: Path, s: int = 384) -> None:
    """24 sRGB-encoded JPEGs and the dome's .lp file."""
    folder.mkdir(parents=True)
    lights = dome(24, 70)
    v, u = np.mgrid[-1 : 1 : 1j * s, -1 : 1 : 1j * s]
    clay = np.stack([0.62 + 0 * u, 0.46 + 0.02 * np.sin(9 * v), 0.33 + 0.02 * np.cos(7 * u)], axis=-1)
    names = [f"tablet_{j + 1:02d}.jpg" for j in range(len(lights))]
    for name, picture in zip(names, photographs(tablet_height(s), clay, lights, 0.05), strict=True):
        x = picture.clip(0, 1)
        encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
        write(folder / name, np.rint(255 * encoded).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 95])
    (folder / "dome.lp").write_bytes(lp(names, lights))


def cloth(folder: Path, sphere: Path, s: int = 384) -> None:
    """Eight 16-bit pictures of a cloth, and eight of a mirror sphere under the same lamps."""
    lights = ring(8, 45)
    folder.mkdir(parents=True)
    sphere.mkdir(parents=True)
    v, u = np.mgrid[-1 : 1 : 1j * s, -1 : 1 : 1j * s]
    stripe = (np.sin(18 * (v + 0.04 * np.sin(5 * u))) > 0.75)[..., None]
    dyed = np.where(stripe, [0.75, 0.68, 0.5], [0.16, 0.3, 0.45])
    for j, picture in enumerate(photographs(cloth_height(s), dyed, lights, 0.02)):
        write(folder / f"{j + 1}.png", np.rint(65535 * picture.clip(0, 1)).astype(np.uint16))
    row, column = np.mgrid[:240, :320].astype(float)
    x, y, r = 160.4, 118.7, 84.0
    for j, light in enumerate(lights):
        half = light + np.array([0, 0, 1])
        half /= np.linalg.norm(half)
        spot = (column - x - r * half[0]) ** 2 + (row - y + r * half[1]) ** 2
        picture = np.where(np.hypot(column - x, row - y) < r, 0.03, 0.09) + 2 * np.exp(-spot / 9)
        noise = 0.003 * np.random.default_rng(j).standard_normal(picture.shape)
        write(sphere / f"{j + 1}.png", np.rint(255 * (picture + noise).clip(0, 1)).astype(np.uint8))


def write(path: Path, picture: np.ndarray, options: list[int] | None = None) -> None:
    """A picture, RGB or grey."""
    bgr = np.ascontiguousarray(picture[..., ::-1]) if picture.ndim == 3 else picture
    cv2.imencode(path.suffix, bgr, options or [])[1].tofile(path)


if __name__ == "__main__":
    root = Path(sys.argv[1])
    tablet(root / "tablet")
    cloth(root / "cloth", root / "sphere")
