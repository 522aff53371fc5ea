"""The reflectance that goes with given normals."""

from __future__ import annotations

import threading

import numpy as np
from jaxtyping import Float

from photonormal.solve.engine.near import seen_as_distant
from photonormal.types import Capture, Normals


def lambertian_albedo(capture: Capture, normals: Normals) -> Float[np.ndarray, "h w 3"]:
    """Albedo of each channel, zero outside: argmin over rho of sum_j (I_j - rho s_j)^2 with s_j = max(n.l_j, 0).

    Linear, in the unit of the images (1 is a saturated sample under a light of intensity 1). Highlights brighten it.
    """
    capture = seen_as_distant(capture, normals)
    N = normals.map[normals.mask]  # (p, 3)
    if capture.lights_at is None:
        cos = N @ capture.known_lights().T.astype(np.float32)  # (p, n)
    else:
        cos = np.einsum("pi,pni->pn", N, capture.lights_at[normals.mask[capture.mask]])
    S = np.maximum(cos, 0)
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
