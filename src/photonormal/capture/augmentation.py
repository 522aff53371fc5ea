"""One augmented window of a sample with true normals: random images, scale, crop, gain and noise (PS-FCN's code).

What networks learn from on disk, and what the paper validates on.
"""

from __future__ import annotations

import numpy as np

from photonormal.types import Capture, InputError, Normals

IMAGES = 32
CROP = 32  # pixels a side
GAIN = (1.0, 3.0)
LIMIT = 2.0  # samples are clipped to it after the gain
NOISE = 0.025  # half width; the paper says 0.05, the published code has (U(0, 1) - 0.5) 0.05
TRIES = 100  # crops that may miss the object


def augmented(
    capture: Capture, g: np.random.Generator, images: int = IMAGES, crop: int = CROP, exposed: bool = True
) -> Capture:
    """One window of a sample; `g` fixes all of it.

    `images` of the pictures, scaled to sides of `crop` to one less than theirs, drawn apart (bilinear), and cut to
    `crop` x `crop`; normals are scaled with them and unit again, lights stay. Crops without a pixel of the object are
    drawn again. `exposed`: times one gain, clipped, plus uniform noise, for pictures that never met a camera.
    """
    import cv2

    n, h, w, _ = capture.images.shape
    truth, lights = capture.truth, capture.known_lights()
    if truth is None or n < images or min(h, w) < crop:
        have = f"{n} images of {h} x {w} pixels and {'no ' * (truth is None)}true normals"
        raise InputError(
            f"{capture.name} has {have} but {images} images of at least {crop} pixels a side with true normals are "
            "needed; leave it out."
        )
    chosen = g.permutation(n)[:images]
    for _ in range(TRIES):
        rows, columns = (int(k) for k in g.integers(crop, (max(h, crop + 1), max(w, crop + 1))))
        top, left = int(g.integers(rows - crop + 1)), int(g.integers(columns - crop + 1))
        cut = np.s_[top : top + crop, left : left + crop]
        map = cv2.resize(truth.map, (columns, rows), interpolation=cv2.INTER_LINEAR)[cut]  # (crop, crop, 3)
        length = np.linalg.norm(map, axis=-1)
        mask = length**2 > 0.01
        if mask.any():
            break
    else:
        raise InputError(f"{capture.name}: {TRIES} crops show nothing of the object; its mask is too small.")
    gain = g.uniform(*GAIN) if exposed else 1.0
    pictures = [cv2.resize(capture.images[int(j)], (columns, rows), interpolation=cv2.INTER_LINEAR) for j in chosen]
    I = np.stack([p.reshape(rows, columns, -1)[cut] for p in pictures])  # (images, crop, crop, c)
    if exposed:
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
