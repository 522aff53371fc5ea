"""The reflectance that goes with given normals."""

from __future__ import annotations

import threading

import numpy as np
from jaxtyping import Float

from photonormal.types import Capture, Normals


def lambertian_albedo(capture: Capture, normals: Normals) -> Float[np.ndarray, "h w 3"]:
    """Albedo of each channel, zero outside: argmin over rho of sum_j (I_j - rho s_j)^2 with s_j = max(n.l_j, 0).

    Linear, in the unit of the images (1 is a saturated sample under a light of intensity 1). Highlights brighten it.
    """
    N = normals.map[normals.mask]  # (p, 3)
    S = np.maximum(N @ capture.known_lights().T.astype(np.float32), 0)  # (p, n)
    weighted = np.zeros((len(N), capture.images.shape[3]), np.float32)
    lock = threading.Lock()

    def add(j: int, image: np.ndarray) -> None:
        part = S[:, j, None] * image[normals.mask]
        with lock:
            weighted.__iadd__(part)

    capture.map_images(add)
    albedo = np.zeros(normals.map.shape, np.float32)
    albedo[normals.mask] = weighted / np.maximum((S**2).sum(1, keepdims=True), 1e-6)
    return albedo
