"""Least squares under the Lambertian model: R. J. Woodham, Optical Engineering 19(1), 1980."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.solve.observations import normalised, per_pixel
from photonormal.types import Capture, Normals


@dataclass(frozen=True)
class Woodham:
    """All samples of a pixel, shadowed or shining, enter one linear fit: exact on a matt surface that all lights reach.

    Highlights pull the normal towards the half vector, shadows push it away from the dark side. Needs 3 lights.
    """

    def __call__(self, capture: Capture, device: torch.device) -> Normals:
        return per_pixel(self.normals, capture, device, torch.float32)

    def normals(self, I: Float[Tensor, "*b p n"], L: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b p 3"]:
        """Unit normals from grey levels and lights; leading batch dimensions are allowed."""
        return normalised(scaled_normals(I, L))


def scaled_normals(I: Float[Tensor, "*b p n"], L: Float[Tensor, "*b n 3"]) -> Float[Tensor, "*b p 3"]:
    """b = argmin |L b - i|^2 = L^+ i for every pixel: the normal times the albedo."""
    return I @ torch.linalg.pinv(L).transpose(-1, -2)
