"""PS-FCN (Chen, Han, Wong, ECCV 2018) and its normalised version (Chen, Han, Shi, Matsushita, Wong, TPAMI 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from photonormal.methods.learned.lambertian_prior import over_images
from photonormal.methods.learned.layers import conv, deconv, kaiming, unit
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.network import Network, at_pixels
from photonormal.methods.learned.pooling import Pooled
from photonormal.methods.learned.weights import load_network
from photonormal.types import InputError


@dataclass(frozen=True)
class PSFCNConfig:
    """The network's switches; the defaults have 2.21 million parameters.

    Parameters
    ----------
    width : channels of the first layer; twice and four times as many follow
    normalised : divide observations by each pixel's and channel's root mean square over the images (2020)
    prior : always "": no classical method enters
    """

    width: int = 64
    normalised: bool = False
    prior: str = ""


class FusedNetwork(Network):
    """Images and lights, one by one through an extractor, fused by the maximum, to unit normals by a regressor."""

    extractor: nn.Module
    regressor: nn.Module

    def begin(self, prior: Float[Tensor, "b 3 h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> None:
        return None

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        b, k, _, h, w = images.shape
        lights = at_pixels(lights).expand(b, k, 3, h, w).to(images.dtype)
        phi = torch.cat([images.expand(b, k, 3, h, w), lights], dim=2)  # (b, k, 6, h, w)
        x = self.extractor(phi.flatten(0, 1).contiguous(memory_format=torch.channels_last))
        return Pooled(over_images(x, k))

    def look(self, digested: Pooled, n: int, shared: Any) -> Float[Tensor, "b 3 h w"]:
        return unit(self.regressor(digested.maximum))


class PSFCNNet(FusedNetwork):
    """Scaled images (b, n, 3, h, w) and lights (b, n, 3) to unit normals (b, 3, h, w); sizes are multiples of 4."""

    Config: ClassVar[type] = PSFCNConfig
    stride = 4
    reach = 32
    widens = True

    def __init__(self, config: PSFCNConfig = PSFCNConfig()) -> None:
        super().__init__()
        self.config = config
        self.scaling = "channels" if config.normalised else "exposure"
        w = config.width
        self.extractor = nn.Sequential(
            conv(6, w), conv(w, 2 * w, stride=2), conv(2 * w, 2 * w), conv(2 * w, 4 * w, stride=2),
            conv(4 * w, 4 * w), deconv(4 * w, 2 * w), conv(2 * w, 2 * w),
        )  # fmt: skip
        self.regressor = nn.Sequential(
            conv(2 * w, 2 * w), conv(2 * w, 2 * w), deconv(2 * w, w), nn.Conv2d(w, 3, 3, padding=1, bias=False)
        )
        kaiming(self)


@dataclass(frozen=True)
class PSFCN(Learned):
    """PS-FCN (Chen, Han, Wong, ECCV 2018): no prior."""

    name = "psfcn"

    def network(self) -> Network:
        return psfcn(self.file, normalised=False)


@dataclass(frozen=True)
class PSFCNNormalised(Learned):
    """PS-FCN on normalised observations (Chen, Han, Shi, Matsushita, Wong, TPAMI 2020): no prior."""

    name = "psfcn-normalised"

    def network(self) -> Network:
        return psfcn(self.file, normalised=True)


def psfcn(file: Path, normalised: bool) -> Network:
    """PS-FCN's network from a weights file that was trained with or without normalised observations."""
    net = load_network(file, "psfcn")
    if net.config.normalised != normalised:
        kind = "psfcn-normalised" if net.config.normalised else "psfcn"
        raise InputError(f"weights {file} are for {kind}; measure with method {kind}, or give other weights.")
    return net
