"""What images are divided by before a network reads them, so that exposure changes nothing."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.inputs.grey import grey

MEAN = 0.25  # mean of an object's pixels after scaling by its exposure; highlights are cut at CUT
CUT = 2.0
CUT_RMS = 6.0  # highlights of a pixel are cut at this multiple of its root mean square over the images


def moment(scaling: str, images: Float[Tensor, "b k c h w"], mask: Bool[Tensor, "b 1 h w"]) -> Float[Tensor, "b d i j"]:
    """What `scaled` needs to know of k images; moments of further images are added to it."""
    if scaling == "exposure":
        inside = images * mask[:, None]  # (b, k, c, h, w)
        return inside.sum((1, 2, 3, 4))[:, None, None, None] / (mask.sum((1, 2, 3), keepdim=True) * images.shape[2])
    if scaling == "grey":
        images = grey(images)
    return images.square().sum(1)


def scaled(
    scaling: str,
    images: Float[Tensor, "b k c h w"],
    mask: Bool[Tensor, "b 1 h w"],
    moments: Float[Tensor, "b d i j"],
    n: int,
) -> Float[Tensor, "b k e h w"]:
    """Images as the network reads them: free of exposure, highlights cut, zero outside the mask.

    `moments` is the sum of `moment` over all n images.
    """
    if scaling == "exposure":
        images, scale, cut = MEAN * images, moments / n, CUT  # (b, 1, 1, 1)
    else:
        images = grey(images) if scaling == "grey" else images
        scale, cut = (moments / n).sqrt(), CUT_RMS  # (b, c, h, w)
    scale = torch.where((scale > 0) & mask, scale, torch.inf)
    return (images / scale[:, None]).clamp(max=cut)
