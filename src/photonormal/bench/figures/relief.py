"""A surface seen from the side, drawn without a graphics card."""

from __future__ import annotations

import numpy as np

from photonormal.types import Normals, Surface

SIZE = 360  # pixels of the picture's longer side
TURN_DEG, TILT_DEG = 35.0, 20.0  # about the vertical, to the viewer
FINE = 1.5  # points drawn for each pixel of the picture, so that steep parts show no gaps
LIGHT = (-0.45, 0.5, 0.74)  # from the upper left, in the turned frame


def relief(surface: Surface, normals: Normals) -> np.ndarray:
    """A matt grey picture (h, w, 3) of an orthographic surface, turned about the vertical and tilted to the viewer."""
    import cv2

    mask = surface.mask & normals.mask & np.isfinite(surface.depth)
    a, t = np.radians(TURN_DEG), np.radians(TILT_DEG)
    about_y = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]])
    R = about_x @ about_y
    row, column = np.indices(mask.shape)
    lowest, highest = np.quantile(surface.depth[mask], (0.002, 0.998))  # single peaks must not shrink the rest
    depth = np.nan_to_num(surface.depth).clip(lowest, highest)
    points = np.stack([column, -row, depth], -1) @ R.T  # (h, w, 3)
    light = np.array(LIGHT) / np.linalg.norm(LIGHT)
    shade = 0.15 + 0.8 * np.clip(normals.map @ R.T @ light, 0, 1)  # (h, w)
    values = np.concatenate([points, shade[..., None], mask[..., None]], -1).astype(np.float32)
    extent = np.ptp(points[mask][:, :2], axis=0)
    scale = (SIZE - 2) / extent.max()
    w, h = (np.ceil(scale * extent) + 2).astype(int)
    fine = int(np.ceil(max(FINE * scale, 2)))
    values = cv2.resize(values, None, fx=fine, fy=fine, interpolation=cv2.INTER_LINEAR)
    values = values[values[..., 4] > 0.999]  # between pixels of the mask only
    x, y = ((values[:, :2] - values[:, :2].min(0)) * scale).T
    places = [  # every point covers two by two
        (h - 1 - np.floor(y).astype(int) - dy) * w + np.floor(x).astype(int) + dx for dy in (0, 1) for dx in (0, 1)
    ]
    order = np.argsort(values[:, 2])  # the nearest is written last
    picture = np.ones(h * w)
    picture[np.stack(places, -1)[order].ravel()] = np.repeat(values[order, 3], 4)
    return np.repeat(np.rint(255 * picture.reshape(h, w, 1)).astype(np.uint8), 3, -1)
