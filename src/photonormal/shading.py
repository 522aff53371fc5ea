"""The image-formation equation, stated once: I = e rho(n, l, v) max(n.l, 0).

The renderer builds images with it, the solvers invert it and the tests check both against it. Torch tensors on any
device; leading dimensions broadcast. The view is v = (0, 0, 1); `e` = 1, since images are divided by it on reading.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

LUMA = (0.298936, 0.587043, 0.114021)  # red, green, blue: the grey level of every published classical figure


def cosines(N: Float[Tensor, "*p 3"], L: Float[Tensor, "*n 3"]) -> Float[Tensor, "*pn"]:
    """n.l for each normal (..., p, 3) and each light (..., n, 3): (..., p, n), negative where a surface looks away."""
    return N @ L.transpose(-1, -2)


def half_vectors(L: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """h = (l + v) / |l + v|, unit, halfway between each light and the view."""
    H = L + L.new_tensor([0.0, 0.0, 1.0])
    return H / H.norm(dim=-1, keepdim=True)


def shade(rho: Float[Tensor, "*rho"] | float, cos: Float[Tensor, "*pn"]) -> Tensor:
    """I = rho max(n.l, 0): radiance of a reflectance `rho` (any shape that broadcasts) at cosines `cos`."""
    return rho * cos.clamp(min=0)
