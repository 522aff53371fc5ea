"""A stream of toy scenes: random quadrics, matt with a Blinn-Phong highlight, lit from a cone; no shadows are cast."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F


class Batch(NamedTuple):
    images: Tensor  # (b, n, 3, h, w)
    lights: Tensor  # (b, n, 3)
    normals: Tensor  # (b, 3, h, w)
    mask: Tensor  # (b, 1, h, w)


class Toy:
    """As photonormal.synth.Stream: seeded, resumable; `recipe` is the number of images."""

    def __init__(self, recipe, batch, device, seed, start_step=0, side=16):
        self.n, self.batch, self.device, self.seed, self.step, self.side = (
            int(recipe),
            batch,
            device,
            seed,
            start_step,
            side,
        )

    def __iter__(self):
        while True:
            g = torch.Generator().manual_seed(self.seed * 1_000_003 + self.step)
            self.step += 1
            yield Batch(*(x.to(self.device) for x in scenes(self.batch, self.n, self.side, g)))


def scenes(b, n, side, g):
    def rand(*shape, low=0.0, high=1.0):
        return low + (high - low) * torch.rand(shape, generator=g)

    y, x = torch.meshgrid(torch.linspace(1, -1, side), torch.linspace(-1, 1, side), indexing="ij")
    a = rand(b, 5, 1, 1, low=-0.8, high=0.8)  # z = ax + by + cxx + dxy + eyy
    zx = a[:, 0] + 2 * a[:, 2] * x + a[:, 3] * y
    zy = a[:, 1] + a[:, 3] * x + 2 * a[:, 4] * y
    N = F.normalize(torch.stack([-zx, -zy, torch.ones_like(zx)], 1), dim=1)  # (b, 3, h, w)
    L = F.normalize(torch.cat([rand(b, n, 2, low=-0.8, high=0.8), torch.ones(b, n, 1)], -1), dim=-1)
    H = F.normalize(L + torch.tensor([0, 0, 1.0]), dim=-1)
    cos, half = (torch.einsum("bnc,bchw->bnhw", v, N).clamp(min=0) for v in (L, H))
    matt, shine = rand(b, 1, 3, 1, 1, low=0.2), rand(b, 1, 1, 1, 1, high=2.0)
    exponent = rand(b, 1, 1, 1, low=2.0, high=20.0)
    images = (matt * cos[:, :, None] + shine * (half**exponent)[:, :, None] * (cos > 0)[:, :, None]) / 2
    mask = torch.ones(b, 1, side, side, dtype=torch.bool)
    mask[:, :, :2] = False
    return images * mask[:, None], L, N * mask, mask
