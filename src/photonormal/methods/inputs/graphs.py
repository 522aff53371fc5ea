"""The samples of a pixel as a graph: a star whose leaves are what it shows under each light."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

LEAF = 4  # numbers of a leaf


def leaves(I: Float[Tensor, "b k h w"], lights: Float[Tensor, "b k 3 *hw"]) -> Float[Tensor, "bhw k 4"]:
    """Each pixel's samples with their lights, (I, l); lights that all pixels share, or each pixel's own."""
    b, k, h, w = I.shape
    L = (lights if lights.ndim == 5 else lights[..., None, None]).expand(b, k, 3, h, w)
    return torch.cat([I[:, :, None], L.to(I.dtype)], dim=2).permute(0, 3, 4, 1, 2).reshape(b * h * w, k, LEAF)
