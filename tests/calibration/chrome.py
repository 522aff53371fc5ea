"""Photographs of a mirror sphere, drawn from the law of reflection: the highlight lies where n halves l and v."""

from __future__ import annotations

import numpy as np

SHAPE, CENTRE, RADIUS = (240, 320), (150.3, 117.6), 81.4


def highlight_at(light: np.ndarray, centre=CENTRE, radius=RADIUS) -> tuple[float, float]:
    """Pixel of a distant light's reflection under the view (0, 0, 1)."""
    half = np.array(light) / np.linalg.norm(light) + [0, 0, 1]
    half = half / np.linalg.norm(half)
    return centre[0] + radius * half[0], centre[1] - radius * half[1]


def photograph(spots, centre=CENTRE, radius=RADIUS, shape=SHAPE, seed=0, sphere=0.03, ground=0.08) -> np.ndarray:
    """8-bit grey picture: dark sphere on a lighter ground, bright `spots` (x, y, pixels of radius) that saturate."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    inside = (radius + 0.5 - np.hypot(x - centre[0], y - centre[1])).clip(0, 1)
    picture = ground * (1 - inside) + sphere * inside
    for sx, sy, width in spots:
        picture += 2 * np.exp(-(((x - sx) ** 2 + (y - sy) ** 2) / width**2))
    picture += 0.004 * rng.standard_normal(shape)
    return np.rint(255 * picture.clip(0, 1)).astype(np.uint8)


def dome(n: int = 12, widest_deg: float = 60.0) -> np.ndarray:
    """Lights (n, 3) spread over a cap around the view."""
    k = np.arange(n) + 0.5
    theta, phi = np.radians(widest_deg) * np.sqrt(k / n), k * np.pi * (1 + 5**0.5)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def write_pictures(folder, pictures, mask=None, name="{:02d}.png") -> None:
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    for j, picture in enumerate(pictures):
        cv2.imencode(".png", picture)[1].tofile(folder / name.format(j + 1))
    if mask is not None:
        cv2.imencode(".png", mask.astype(np.uint8) * 255)[1].tofile(folder / "mask.png")


def write_chrome(folder, lights, spot=3.0, mask=False, **how) -> None:
    """One picture for each light."""
    place = {k: how[k] for k in ("centre", "radius") if k in how}
    pictures = [photograph([(*highlight_at(l, **place), spot)], seed=j, **how) for j, l in enumerate(lights)]
    y, x = np.mgrid[: pictures[0].shape[0], : pictures[0].shape[1]]
    (cx, cy), r = how.get("centre", CENTRE), how.get("radius", RADIUS)
    write_pictures(folder, pictures, (x - cx) ** 2 + (y - cy) ** 2 < r**2 if mask else None)
