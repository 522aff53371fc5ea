"""Measured isotropic materials: W. Matusik, H. Pfister, M. Brand, L. McMillan, ACM SIGGRAPH 2003."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.synth.brdf.neural import half_difference
from photonormal.types import InputError

SHAPE = (90, 90, 180)  # theta_h (square-root spaced), theta_d, phi_d
SCALE = (1 / 1500, 1.15 / 1500, 1.66 / 1500)


@dataclass(frozen=True)
class Merl:
    """Tables (b, 90, 90, 180, 3) of f, looked up at the nearest sample."""

    table: Float[Tensor, "b 90 90 180 3"]

    def __call__(self, cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Float[Tensor, "b n 3 p"]:
        _, (d_x, d_y, _) = half_difference(cos_l, cos_h, cos_d)
        cos_l, cos_h, cos_d = torch.broadcast_tensors(cos_l, cos_h, cos_d)
        i = ((torch.acos(cos_h.clamp(0, 1)) * (2 / torch.pi)).sqrt() * 90).long().clamp(max=89)
        j = (torch.acos(cos_d.clamp(0, 1)) * (2 / torch.pi) * 90).long().clamp(max=89)
        k = (torch.atan2(d_y, d_x) * (180 / torch.pi)).long().clamp(max=179)  # atan2 >= 0 since d_y >= 0
        scene = torch.arange(len(self.table), device=cos_h.device).view(-1, 1, 1)
        index = ((scene * 90 + i) * 90 + j) * 180 + k
        return self.table.reshape(-1, 3)[index].transpose(-1, -2)


def read_merl(path: Path | str) -> Float[Tensor, "90 90 180 3"]:
    """Table of a MERL ``.binary`` file: three int32 (90, 90, 180), then the planes R, G, B of float64.

    Samples that the measurement marks as invalid (negative) take the value of the next valid one towards theta_d = 0.

    Raises
    ------
    InputError
        If the file can't be read, or its size or header isn't that of a MERL material.
    """
    path = Path(path)
    needed = 12 + 8 * 3 * int(np.prod(SHAPE))
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} can't be read ({error.strerror}); give a MERL .binary file.") from None
    if len(data) != needed or tuple(np.frombuffer(data, "<i4", 3)) != SHAPE:
        raise InputError(
            f"{path} has {len(data)} bytes but a MERL material has {needed} after the header 90 90 180; "
            "download the file again."
        )
    f = np.frombuffer(data, "<f8", offset=12).reshape(3, *SHAPE) * np.reshape(SCALE, (3, 1, 1, 1))
    f = np.moveaxis(f, 0, -1).astype(np.float32)  # (90, 90, 180, 3)
    for j in range(1, 90):
        bad = (f[:, j] < 0).any(-1, keepdims=True)
        f[:, j] = np.where(bad, f[:, j - 1], f[:, j])
    return torch.from_numpy(f.clip(min=0))
