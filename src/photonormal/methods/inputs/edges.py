"""Where something changes from pixel to pixel: in pictures, and in normal maps."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F


def gradient(x: Float[Tensor, "*b h w"]) -> Float[Tensor, "2 *b h w"]:
    """Half the difference of a pixel's neighbours, right and left, below and above; beyond the border it is zero."""
    right, left = F.pad(x, (0, 1))[..., 1:], F.pad(x, (1, 0))[..., :-1]
    below, above = F.pad(x, (0, 0, 0, 1))[..., 1:, :], F.pad(x, (0, 0, 1, 0))[..., :-1, :]
    return torch.stack([right - left, below - above]) / 2
