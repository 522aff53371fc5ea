"""Albedo shows what matt shading leaves open: in a wrong frame (`frame.py`) it follows the normals.

Of most objects it is the same over large parts, or changes at edges (after N. Alldrin, S. Mallick, D. Kriegman, CVPR
2007).
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.uncalibrated.frame import BASRELIEF, FEWEST, STEEP, FrameEvidence, as_grid, fitted, part_of

APART = 4  # pixels between which it is compared
FLOOR = (0.02, 0.02, 0.04)  # least standard error under many lights, tilts and depth
FEW = 32  # lights, of which errors are by 1.4 larger: shine pulls normals towards the middle of few lights
TEXTURE = 2500.0  # times the square of what the parts disagree by: texture leads them all astray


def unshaded(
    rho: Float[Tensor, " p"], N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"], lights: int
) -> FrameEvidence | None:
    """What E[0, 2], E[1, 2] and E[2, 2] leave of rho, found with normals N under so many lights, free of the normals.

    rho (1 - n.E n) is, to first order, the albedo in the mapped frame. None where too few pixels have neighbours.
    """
    known = as_grid((rho > 0) & (N[:, 2] > STEEP), inside)
    n = as_grid(N.double(), inside)
    log = as_grid(torch.where(rho > 0, rho, 1).double().log(), inside)
    follows = n * n[..., 2:]  # (h, w, 3)
    pairs = []
    for along in (0, 1):
        one, other = (slice(APART, None), slice(None, -APART))
        if along:
            one, other = (slice(None), one), (slice(None), other)
        both = known[one] & known[other]
        pairs.append(((follows[one] - follows[other])[both], (log[one] - log[other])[both], part_of(both)))
    J, r, part = (torch.cat(v) for v in zip(*pairs, strict=True))
    if len(r) < FEWEST:
        return None
    theta, covariance = fitted(J, r, torch.ones_like(r), part)
    doubt = TEXTURE * covariance.diagonal().sqrt()
    floor = (1 + FEW / lights) * covariance.new_tensor(FLOOR).square().diag()
    return FrameEvidence(BASRELIEF, theta, torch.linalg.inv(doubt[:, None] * covariance * doubt + floor))
