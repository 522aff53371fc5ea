"""The paper's validation: random images, scale, crop, gain and noise, as in training (PS-FCN's published code)."""

from __future__ import annotations

import numpy as np

from photonormal.types import Capture, InputError, Normals

IMAGES = 32
CROP = 32  # pixels a side
GAIN = (1.0, 3.0)
LIMIT = 2.0  # samples are clipped to it after the gain
NOISE = 0.025  # half width; the paper says 0.05, the published code has (U(0, 1) - 0.5) 0.05
TRIES = 100  # crops that may miss the object


def validation_crop(capture: Capture, seed: int) -> Capture:
    """One crop of a sample, its images augmented; `seed` fixes all of it.

    32 of the images, scaled to sides of 32 to 127 pixels drawn apart (bilinear), cut to 32 x 32, times one gain,
    clipped, plus uniform noise. Crops without a pixel of the object are drawn again.
    """
    import cv2

    g = np.random.default_rng(seed)
    n, h, w, _ = capture.images.shape
    truth, lights = capture.truth, capture.known_lights()
    if truth is None or min(n, h, w) < CROP:
        raise InputError(f"{capture.name} has {n} images of {h} x {w} but {IMAGES} of {CROP} pixels a side are needed.")
    chosen = g.permutation(n)[:IMAGES]
    for _ in range(TRIES):
        rows, columns = (int(k) for k in g.integers(CROP, (max(h, CROP + 1), max(w, CROP + 1))))
        top, left = int(g.integers(rows - CROP + 1)), int(g.integers(columns - CROP + 1))
        cut = np.s_[top : top + CROP, left : left + CROP]
        map = cv2.resize(truth.map, (columns, rows), interpolation=cv2.INTER_LINEAR)[cut]  # (32, 32, 3)
        length = np.linalg.norm(map, axis=-1)
        mask = length**2 > 0.01
        if mask.any():
            break
    else:
        raise InputError(f"{capture.name}: {TRIES} crops show nothing of the object; its mask is too small.")
    gain = g.uniform(*GAIN)
    pictures = [cv2.resize(capture.images[int(j)], (columns, rows), interpolation=cv2.INTER_LINEAR) for j in chosen]
    I = np.stack([p.reshape(rows, columns, -1)[cut] for p in pictures])  # (32, 32, 32, c)
    I = np.clip(gain * I, 0, LIMIT) + g.uniform(-NOISE, NOISE, I.shape)
    unit = map / np.maximum(length, 1e-6)[..., None]
    return Capture(
        images=(I * mask[..., None]).astype(np.float32),
        mask=mask,
        lights=lights[chosen],
        truth=Normals(np.where(mask[..., None], unit, 0), mask),
        name=capture.name,
        image_names=tuple(capture.image_names[j] for j in chosen),
    )
