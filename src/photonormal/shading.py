"""The image-formation equation, stated once: I = e rho(n, l, v) max(n.l, 0), with e cos^mu / r^2 for a near lamp's e.

The renderer builds images with it, the solvers invert it and the tests check both against it. Torch tensors on any
device; leading dimensions broadcast. The view is v = (0, 0, 1); `e` = 1, since images are divided by it on reading.
Lights are (..., n, 3) for all pixels, or (..., p, n, 3) where each pixel sees them elsewhere.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

FAINT = 1e-3  # of the light at the object's middle: where less arrives from a near lamp, a sample shows nothing
LUMA = (0.298936, 0.587043, 0.114021)  # red, green, blue: the grey level of every published classical figure


def over_lights(w: Float[Tensor, "*p m"], M: Float[Tensor, "*n m k"]) -> Float[Tensor, "*p k"]:
    """sum_j w_j M_j at each pixel, for M (..., m, k) that all pixels share or (..., p, m, k) that they don't."""
    return w @ M if M.ndim <= w.ndim else (w[..., None, :] @ M)[..., 0, :]


def cosines(N: Float[Tensor, "*p 3"], L: Float[Tensor, "*n 3"]) -> Float[Tensor, "*pn"]:
    """n.l for each normal (..., p, 3) and each light: (..., p, n), negative where a surface looks away."""
    return over_lights(N, L.transpose(-1, -2))


def angle_deg(a: Float[Tensor, "p 3"], b: Float[Tensor, "p 3"]) -> Float[Tensor, " p"]:
    """Angle between vectors in degrees, as `geometry.angle_deg`; 0 where one is zero."""
    return torch.rad2deg(torch.atan2(torch.linalg.cross(a, b).norm(dim=-1), (a * b).sum(-1)))


def normalised(b: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """Unit vectors along `b`; zero where `b` is zero or not finite."""
    length = b.norm(dim=-1, keepdim=True)
    return torch.where(torch.isfinite(length) & (length > 0), b / length, torch.zeros_like(b))


def towards(
    X: Float[Tensor, "*b p 3"], S: Float[Tensor, "*b n 3"]
) -> tuple[Float[Tensor, "*b p n 3"], Float[Tensor, "*b p n"]]:
    """Unit vectors from points to lamps, and their distances."""
    d = S[..., None, :, :] - X[..., :, None, :]
    r = d.norm(dim=-1)
    return d / r[..., None], r


def fall_off(
    L: Float[Tensor, "*b p n 3"],
    r: Float[Tensor, "*b p n"],
    axes: Float[Tensor, "*b n 3"] | None = None,
    mu: Float[Tensor, "*b n"] | None = None,
) -> Float[Tensor, "*b p n"]:
    """cos^mu / r^2: light that arrives from lamps, each of which shines most along its axis (None: evenly)."""
    if axes is None or mu is None:
        return r**-2
    cos = -(L * axes[..., None, :, :]).sum(-1)
    return cos.clamp(min=0) ** mu[..., None, :] / r**2


def half_vectors(L: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """h = (l + v) / |l + v|, unit, halfway between each light and the view; zero for a light from right behind."""
    return normalised(L + L.new_tensor([0.0, 0.0, 1.0]))


def shade(rho: Float[Tensor, "*rho"] | float, cos: Float[Tensor, "*pn"]) -> Tensor:
    """I = rho max(n.l, 0): radiance of a reflectance `rho` (any shape that broadcasts) at cosines `cos`."""
    return rho * cos.clamp(min=0)


def schlick(cos_d: Tensor) -> Tensor:
    """(1 - l.h)^5: a mirror facet of reflectance F0 reflects F0 + (1 - F0) times that."""
    x = (1 - cos_d).clamp(0, 1)
    return x.square().square() * x


def smith(cos: Tensor, a2: Tensor | float) -> Tensor:
    """Smith's masking of GGX, over 2 cos: two of them make G / (4 n.l n.v)."""
    c2 = cos.square()
    return 1 / (cos + (a2 + c2 - a2 * c2).sqrt()).clamp(min=1e-3)


def ggx(cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, a2: Tensor) -> Tensor:
    """D G / (4 n.l n.v), in 1/sr: the highlight of perfect mirror facets whose roughness is a2^(1/4), before Fresnel.

    B. Walter et al., Microfacet models for refraction through rough surfaces, EGSR 2007.
    """
    t = (a2 - 1) * cos_h.square() + 1
    return a2 / (math.pi * t.square()) * smith(cos_l, a2) * smith(cos_v, a2)
