"""The interface of every learned method: encode each image, pool over the images, decode once.

Training calls the network on a batch; measuring feeds the same three steps image by image. There is no second path.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from photonormal.shading import LUMA
from photonormal.solve.learned.pooling import Pooled

MEAN = 0.25  # mean of an object's pixels after scaling by its exposure; highlights are cut at CUT
CUT = 2.0
CUT_RMS = 6.0  # highlights of a pixel are cut at this multiple of its root mean square over the images


class Network(nn.Module, ABC):
    """Normals from images, lights and a prior.

    Attributes
    ----------
    scaling : what the images are divided by, so that exposure changes nothing: "exposure" (mean over the object),
        "channels" (each pixel's and channel's root mean square over the images) or "grey" (that of its grey level)
    stride : image sizes must be multiples of it
    reach : how many pixels away an input can change an output
    floats : numbers per pixel kept between images while measuring (pooled and shared features)
    pointwise : whether `encode` and `digest` see each pixel by itself; what `begin` gives then has `rows(some)`
    memory : channels that follow the normals in what `decode` gives and go into the next pass, beside the normals
    Config : the frozen dataclass that `config` is one of
    config : what builds the network again; its field `prior` names a classical method, or is ""
    """

    Config: ClassVar[type]
    scaling: str
    stride: int
    reach: int
    floats: int
    pointwise: bool = False
    memory: int = 0
    config: Any

    @abstractmethod
    def begin(self, prior: Float[Tensor, "b c h w"], lights: Float[Tensor, "b n 3 *hw"]) -> Any:
        """What all images share, computed once from the prior (zero outside the object) and the lights of them all.

        The prior is normals (3 channels), or an earlier pass's normals and memory.
        """

    @abstractmethod
    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        """The pooled features of k scaled images: some of the n, or all."""

    def digest(self, pooled: Pooled, n: int, shared: Any) -> Any:
        """What is looked at of the pooled features of all n images: rows (b, h, w, ...) where `pointwise`."""
        return pooled

    @abstractmethod
    def look(self, digested: Any, n: int, shared: Any) -> Float[Tensor, "b d h w"]:
        """Unit normals, `memory` channels, and from a network that has learned it the expected error in degrees."""

    def decode(self, pooled: Pooled, n: int, shared: Any) -> Float[Tensor, "b d h w"]:
        """What `look` gives, from the pooled features of all n images."""
        return self.look(self.digest(pooled, n, shared), n, shared)

    def forward(
        self,
        images: Float[Tensor, "b n c h w"],
        lights: Float[Tensor, "b n 3 *hw"],
        prior: Float[Tensor, "b 3 h w"],
        passes: int = 1,
    ) -> Float[Tensor, "q d h w"]:
        """What `decode` gives, from scaled images (`scaled`), unit lights and the prior; q is b times the passes.

        Lights are (b, n, 3), or (b, n, 3, h, w) where each pixel sees them elsewhere. The normals of a pass are the
        prior of the next, which learns to better them but not to have them otherwise; its memory learns to help.
        """
        outside = prior.square().sum(1, keepdim=True) == 0
        found: list[Tensor] = []
        for _ in range(passes):
            shared = self.begin(prior, lights)
            found.append(self.decode(self.encode(images, lights, shared), images.shape[1], shared))
            N, memory = found[-1][:, :3].detach(), found[-1][:, 3 : 3 + self.memory]
            prior = torch.cat([N, memory.to(N.dtype)], dim=1).masked_fill(outside, 0)
        return torch.cat(found) if passes > 1 else found[0]


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


def at_pixels(lights: Float[Tensor, "b k 3 *hw"]) -> Float[Tensor, "b k 3 h w"]:
    """Lights of each pixel, or (b, k, 3, 1, 1) that all share."""
    return lights if lights.ndim == 5 else lights[..., None, None]


def grey(images: Float[Tensor, "b k c h w"]) -> Float[Tensor, "b k 1 h w"]:
    """Luma of three channels; one channel is grey already."""
    if images.shape[2] == 1:
        return images
    return torch.einsum("bkchw,c->bkhw", images, images.new_tensor(LUMA))[:, :, None]


def placed(net: Network, device: torch.device | str) -> Network:
    """The network on a device, its filters in the memory order that convolutions are fastest with."""
    return net.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]


def parameters(network: nn.Module) -> int:
    """How many numbers the network has learned."""
    return sum(p.numel() for p in network.parameters())
