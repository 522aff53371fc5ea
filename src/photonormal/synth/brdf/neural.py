"""Neural fits of measured materials: A. Sztrajman, G. Rainer, T. Ritschel, T. Weyrich, Computer Graphics Forum 2021."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Neural:
    """One 6-21-21-3 network per scene: f = exp(net(half vector, difference vector)) - 1 in the local frame."""

    w1: Float[Tensor, "b 6 21"]
    w2: Float[Tensor, "b 21 21"]
    w3: Float[Tensor, "b 21 3"]
    b1: Float[Tensor, "b 21"]
    b2: Float[Tensor, "b 21"]
    b3: Float[Tensor, "b 3"]

    def __call__(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "b n 3 p"]:
        h, d = half_difference(cos_l, cos_h, cos_d)  # (b, n, p) each
        x = torch.stack([*h, *d], -1)  # (b, n, p, 6)
        shape = x.shape[:-1]
        x = x.flatten(1, -2)
        x = torch.baddbmm(self.b1[:, None], x, self.w1).relu_()
        x = torch.baddbmm(self.b2[:, None], x, self.w2).relu_()
        x = torch.baddbmm(self.b3[:, None], x, self.w3).exp_().sub_(1).clamp_(0, 1e3)
        return x.view(*shape, 3).transpose(-1, -2)


def half_difference(cos_l: Tensor, cos_h: Tensor, cos_d: Tensor) -> tuple[tuple[Tensor, ...], tuple[Tensor, ...]]:
    """Half and difference vectors in the frame of S. Rusinkiewicz (EGWR 1998), h in the plane y = 0.

    n is (-sin_h, 0, cos_h) once h points along z, so n.l = cos_h d_z - sin_h d_x gives d_x; d_y's sign is lost, which
    an isotropic and mirror-symmetric material doesn't notice.
    """
    cos_l, cos_h, cos_d = torch.broadcast_tensors(cos_l, cos_h, cos_d)
    sin_h = (1 - cos_h.square()).clamp(min=0).sqrt()
    sin_d = (1 - cos_d.square()).clamp(min=0).sqrt()
    d_x = (cos_h * cos_d - cos_l) / sin_h.clamp(min=1e-4)
    d_x = torch.maximum(torch.minimum(d_x, sin_d), -sin_d)
    d_y = (sin_d.square() - d_x.square()).clamp(min=0).sqrt()
    return (sin_h, torch.zeros_like(sin_h), cos_h), (d_x, d_y, cos_d)
