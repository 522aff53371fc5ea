"""Least squares under the Lambertian model: R. J. Woodham, Optical Engineering 19(1), 1980."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.shading import normalised, over_lights

SINGULAR = 1e-6  # relative determinant below which the samples of a pixel do not fix a normal


@dataclass(frozen=True)
class Woodham:
    """All samples of a pixel, shadowed or shining, enter one linear fit: exact on a matt surface that all lights reach.

    Highlights pull the normal towards the half vector, shadows push it away from the dark side. Needs 3 lights.
    """

    needs: ClassVar[Needs] = Needs()

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.normals(seen.I, seen.lights))

    def normals(
        self, I: Float[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"], dark: float | None = None
    ) -> Float[Tensor, "*b p 3"]:
        """Unit normals from all grey levels, dark or not, and lights, as `photonormal.shading` has them; batches are
        allowed."""
        return normalised(scaled_normals(I, L))


def scaled_normals(I: Float[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"]) -> Float[Tensor, "*b p 3"]:
    """b = argmin |L b - i|^2 = L^+ i for every pixel: the normal times the albedo."""
    return over_lights(I, torch.linalg.pinv(L).transpose(-1, -2))


def weighted_normals(
    I: Float[Tensor, "*b p n"], w: Float[Tensor, "*b p n"] | Bool[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"]
) -> Float[Tensor, "*b p 3"]:
    """b = argmin sum_j w_j (l_j.b - I_j)^2 for every pixel; least squares where those weighted do not fix it."""
    w = w.to(I.dtype)
    A, fixed = symmetric_inverse(over_lights(w, pairs(L)))  # (*b, p, 6)
    b = symmetric_product(A, over_lights(w * I, L))
    return b if bool(fixed.all()) else torch.where(fixed, b, scaled_normals(I, L))


def pairs(L: Float[Tensor, "*l n 3"]) -> Float[Tensor, "*l n 6"]:
    """The products xx xy xz yy yz zz: ``w @ pairs(L)`` are the 3 x 3 normal equations sum_j w_j l_j l_j^T."""
    x, y, z = L.unbind(-1)
    return torch.stack([x * x, x * y, x * z, y * y, y * z, z * z], dim=-1)


def symmetric_inverse(A: Float[Tensor, "*p 6"]) -> tuple[Float[Tensor, "*p 6"], Bool[Tensor, "*p 1"]]:
    """Inverses of symmetric 3 x 3 matrices by cofactors, in double precision; and which of them are regular."""
    xx, xy, xz, yy, yz, zz = _apart(A)
    cofactors = torch.stack(
        [
            yy * zz - yz * yz,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xx * zz - xz * xz,
            xy * xz - xx * yz,
            xx * yy - xy * xy,
        ]
    )
    det = xx * cofactors[0] + xy * cofactors[1] + xz * cofactors[2]
    regular = det > SINGULAR * ((xx + yy + zz) / 3) ** 3
    return (cofactors / torch.where(regular, det, 1)).movedim(0, -1), regular[..., None]


def symmetric_product(A: Float[Tensor, "*p 6"], y: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """A y for symmetric 3 x 3 matrices; in the precision of `y`."""
    xx, xy, xz, yy, yz, zz = A.unbind(-1)
    x, y_, z = _apart(y)
    product = torch.stack([xx * x + xy * y_ + xz * z, xy * x + yy * y_ + yz * z, xz * x + yz * y_ + zz * z])
    return product.movedim(0, -1).to(y.dtype)


def _apart(v: Float[Tensor, "*p k"]) -> Float[Tensor, " k *p"]:
    """Double precision, each of the k by itself in memory, where sums and products of them are fast."""
    return v.movedim(-1, 0).to(torch.float64, memory_format=torch.contiguous_format)
