"""Quadratic programs with non-negative unknowns, many at a time."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

TOGETHER = 6  # steps in which all wrong unknowns change sides; later ones move one, which can't cycle
STEPS = 60


def nonnegative_minimum(G: Float[Tensor, "p m m"], c: Float[Tensor, "p m"]) -> Float[Tensor, "p m"]:
    """x = argmin x'Gx / 2 - c'x over x >= 0, for positive definite G, by block principal pivoting.

    L. F. Portugal, J. J. Judice, L. N. Vicente, Mathematics of Computation 63(208), 1994.
    """
    x = torch.zeros_like(c)
    free = torch.ones_like(c, dtype=torch.bool)  # unknowns that are not held at zero
    open_ = torch.arange(c.shape[0], device=c.device)  # problems not yet solved
    rank = torch.arange(1, c.shape[1] + 1, device=c.device)
    for step in range(STEPS):
        g, f = G[open_], free[open_].to(G.dtype)
        z = torch.linalg.solve(g * f[:, :, None] * f[:, None] + torch.diag_embed(1 - f), c[open_] * f)
        x[open_] = z.clamp(min=0)
        slope = (g @ z[..., None])[..., 0] - c[open_]
        wrong = torch.where(free[open_], z < -1e-12, slope < -1e-9 * c[open_].abs())
        if step >= TOGETHER:  # only the last one
            wrong &= rank == (wrong * rank).amax(1, keepdim=True)
        free[open_] ^= wrong
        open_ = open_[wrong.any(1)]
        if not open_.numel():
            break
    return x
