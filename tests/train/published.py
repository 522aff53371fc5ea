"""Sets in the layout of Blobby and Sculpture, written here from its description, by nothing of the package."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

SIDE, PICTURES = 40, 6


def sphere(side: int = SIDE, seed: int = 0) -> np.ndarray:
    """Normals (side, side, 3) of a ball or an egg, zero around it."""
    squeeze = 1 + 0.2 * (seed % 3)
    y, x = np.mgrid[1 : -1 : side * 1j, -1 : 1 : side * 1j]
    x, y = x / 0.9 * squeeze, y / 0.9
    inside = x**2 + y**2 < 1
    N = np.stack([x * squeeze, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], -1)
    N /= np.linalg.norm(N, axis=-1, keepdims=True)
    return np.where(inside[..., None], N, 0)


def directions(seed: int, n: int = PICTURES) -> np.ndarray:
    """Lights (n, 3) of a hemisphere around the camera."""
    g = np.random.default_rng(seed)
    l = np.concatenate([g.uniform(-0.7, 0.7, (n, 2)), np.ones((n, 1))], 1)
    return l / np.linalg.norm(l, axis=1, keepdims=True)


def write_sample(root: Path, shape: str, material: str, seed: int, side: int = SIDE, n: int = PICTURES) -> Path:
    """One matt sample; returns its folder."""
    folder = root / "Images" / shape / material
    folder.mkdir(parents=True)
    N, L = sphere(side, seed // 2), directions(seed, n)  # two materials share a shape
    code = np.where((N != 0).any(-1, keepdims=True), np.round((N + 1) / 2 * 255), 127).astype(np.uint8)
    cv2.imwrite(str(folder.parent / f"{shape}_normal.png"), code[..., ::-1])
    lines = []
    for l in L:
        name = f"{shape}_{material}_l_{l[0]:.2f},{l[1]:.2f},{l[2]:.2f}.png"
        shading = np.clip(N @ l, 0, None)[..., None] * [0.5, 0.7, 0.9]  # red, green, blue
        cv2.imwrite(str(folder / name), np.round(255 * shading).astype(np.uint8)[..., ::-1])
        lines.append(f"{name} {l[0]:.4f} {l[1]:.4f} {l[2]:.4f}\n")
    (folder / f"{shape}_{material}.txt").write_text("".join(lines))
    return folder


def write_set(root: Path, training: int = 7, validation: int = 2, side: int = SIDE, n: int = PICTURES) -> Path:
    """A set of matt eggs; shape and material are numbered through, training first."""
    keys = [f"blob{i // 2:02d}/matt-{i}" for i in range(training + validation)]
    for i, key in enumerate(keys):
        write_sample(root, *key.split("/"), seed=i, side=side, n=n)
    for name, some in (("train_mtrl.txt", keys[:training]), ("val_mtrl.txt", keys[training:])):
        (root / name).write_text("".join(f"{key}\n" for key in some))
    return root
