"""DR-PSN (Ju, Dong, Chen, IEEE TIP 2021): normals from images, and images back from the normals and their lights.

The way back is only learned from: normals that do not explain the images cost more (`photonormal.train.objective`).
The paper's table of layers is not at hand: these are of the kind that its authors' GR-PSN reconstructs images with. In
place of a known material the way back gets what the images showed in common.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from photonormal.methods.learned.layers import conv, deconv, kaiming
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.network import Network, at_pixels
from photonormal.methods.learned.pooling import Pooled
from photonormal.methods.learned.psfcn import PSFCNConfig, PSFCNNet


@dataclass(frozen=True)
class DRPSNConfig:
    """The network's switches.

    Parameters
    ----------
    width : channels of the first layers, of both ways; twice and four times as many follow
    rendered : how many of a sample's images are rendered back while it learns
    prior : always "": no classical method enters
    """

    width: int = 64
    rendered: int = 8
    prior: str = ""


class DRPSNNet(Network):
    """Scaled images (b, n, 3, h, w) and lights (b, n, 3) to unit normals (b, 3, h, w); sizes are multiples of 4."""

    Config: ClassVar[type] = DRPSNConfig
    scaling = "exposure"
    stride = PSFCNNet.stride
    reach = PSFCNNet.reach
    teaches = "images"

    def __init__(self, config: DRPSNConfig = DRPSNConfig()) -> None:
        super().__init__()
        self.config = config
        self.normals = PSFCNNet(PSFCNConfig(config.width))
        self.back = Renderer(config.width)

    def begin(self, prior: Float[Tensor, "b 3 h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> None:
        return self.normals.begin(prior, lights)

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        return self.normals.encode(images, lights, shared)

    def look(self, digested: Pooled, n: int, shared: Any) -> Float[Tensor, "b 3 h w"]:
        return self.normals.look(digested, n, shared)

    def teach(
        self, images: Float[Tensor, "b n c h w"], lights: Float[Tensor, "b n 3 *hw"], digested: Any, N: Tensor
    ) -> Float[Tensor, "b m h w"]:
        return self.back(N, lights[:, : self.config.rendered], digested.maximum).flatten(1, 2)


class Renderer(nn.Module):
    """Normals, lights and what the images showed in common to images, scaled as those that were read."""

    def __init__(self, width: int) -> None:
        super().__init__()
        w = width
        self.shape = nn.Sequential(conv(6, w), conv(w, 2 * w, stride=2))  # h/2
        self.both = nn.Sequential(conv(4 * w, 2 * w), conv(2 * w, 2 * w), deconv(2 * w, w))  # h
        self.last = nn.Conv2d(w, 3, 3, padding=1)
        kaiming(self)

    def forward(
        self, N: Float[Tensor, "b 3 h w"], lights: Float[Tensor, "b k 3 *hw"], common: Float[Tensor, "b c i j"]
    ) -> Float[Tensor, "b k 3 h w"]:
        b, k, (h, w) = N.shape[0], lights.shape[1], N.shape[2:]
        lit = torch.cat([N[:, None].expand(b, k, 3, h, w), at_pixels(lights).expand(b, k, 3, h, w)], dim=2)
        x = self.shape(lit.flatten(0, 1).contiguous(memory_format=torch.channels_last))
        x = torch.cat([x, common.repeat_interleave(k, dim=0)], dim=1)
        return self.last(self.both(x)).unflatten(0, (b, k))


@dataclass(frozen=True)
class DRPSN(Learned):
    """DR-PSN (Ju, Dong, Chen, IEEE TIP 2021): learned to render its images back; no prior."""

    name = "dr-psn"
