"""Least-squares normals guide a residual network: Y. Ju, M. Jian, S. Guo, Y. Wang, H. Zhou, J. Dong, IEEE TIM 70, 2021.

"Incorporating Lambertian Priors into Surface Normals Measurement".

The text fixes what enters (prior normal, image, light), two branches of six residual blocks with strides in blocks 3
and 5, 512 channels at a quarter of the resolution, the maximum over the images, and a regressor of six convolutions and
three deconvolutions. What it leaves open is a field of `LambertianPriorConfig`; so is every ablation of its tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.methods.learned.layers import Block, conv, deconv, kaiming, unit
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.network import Network, at_pixels
from photonormal.methods.learned.pooling import Pooled, pool
from photonormal.types import InputError

LADDERS = {3: (1, 1, 1), 5: (2, 2, 1), 6: (2, 2, 2), 7: (2, 2, 3)}  # blocks at full, half and quarter resolution


@dataclass(frozen=True)
class LambertianPriorConfig:
    """The network's switches; the defaults are the paper's network as reconstructed (8.05 million parameters).

    Parameters
    ----------
    prior : the classical method whose normals enter ("woodham" in the paper); "": none
    branches : 2 (images and prior apart), or 1 (nine channels into one branch)
    exchange : with two branches, image features enter the prior branch at each scale (True), or only at its end
    blocks : residual blocks of a branch: 3, 5, 6 or 7
    residual : shortcuts around the blocks
    concat : the deconvolution after which the prior enters the regressor: 2, 3, or 0 (not at all)
    width : channels at full resolution, doubled at each of the two strides; a multiple of 8 (strided 1 x 1 convolutions
        of 4 channels make oneDNN 3.12 write beyond its memory)
    """

    prior: str = "woodham"
    branches: int = 2
    exchange: bool = True
    blocks: int = 6
    residual: bool = True
    concat: int = 2
    width: int = 64

    def __post_init__(self) -> None:
        if self.blocks not in LADDERS:
            raise InputError(f"{self.blocks} blocks came but a branch has 3, 5, 6 or 7; choose one of these.")
        if self.branches not in (1, 2) or self.concat not in (0, 2, 3) or self.width % 8 or self.width < 1:
            raise InputError(
                f"branches {self.branches}, concat {self.concat}, width {self.width} came; "
                "branches is 1 or 2, concat 0, 2 or 3, width a multiple of 8."
            )


class Branch(nn.Module):
    """Residual blocks at full, half and quarter resolution; returns the features at the end of each."""

    def __init__(self, inputs: int, config: LambertianPriorConfig, exchange: bool = False) -> None:
        super().__init__()
        widths = [config.width, 2 * config.width, 4 * config.width]
        self.scales = nn.ModuleList()
        for s, (width, count) in enumerate(zip(widths, LADDERS[config.blocks], strict=True)):
            first = Block(inputs, width, 2 if s else 1, config.residual)
            rest = [Block(width, width, 1, config.residual) for _ in range(count - 1)]
            self.scales.append(nn.Sequential(first, *rest))
            inputs = 2 * width if exchange else width

    def forward(self, x: Float[Tensor, "b c h w"]) -> list[Tensor]:
        features = []
        for scale in self.scales:
            x = scale(x)
            features.append(x)
        return features


class SharedPrior(NamedTuple):
    """What all images share."""

    prior: Tensor  # (b, 3, h, w)
    features: Tensor | None  # of the prior branch, as far as no image enters it: (b, c, h, w) or (b, c, h/4, w/4)


class LambertianPriorNet(Network):
    """Scaled images (b, n, 3, h, w), lights (b, n, 3) and prior (b, 3, h, w) to unit normals (b, 3, h, w).

    Sizes must be multiples of 4. Where an image can't reach the prior's features they are computed once for all images.
    """

    Config: ClassVar[type] = LambertianPriorConfig
    scaling = "exposure"
    stride = 4
    widens = True

    def __init__(self, config: LambertianPriorConfig = LambertianPriorConfig()) -> None:
        super().__init__()
        self.config = config
        self.reach = 48 if config.blocks < 7 else 56
        w = config.width
        self.two = bool(config.prior) and config.branches == 2
        self.image = Branch(9 if config.prior and not self.two else 6, config)
        self.prior = Branch(3, config, config.exchange) if self.two else None
        self.regressor = Regressor(8 * w if self.two else 4 * w, w, config.concat if config.prior else 0)
        kaiming(self)

    def begin(self, prior: Float[Tensor, "b 3 h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> SharedPrior:
        if self.prior is None:
            return SharedPrior(prior, None)
        return SharedPrior(prior, self.prior.scales[0](prior) if self.config.exchange else self.prior(prior)[-1])

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        b, k, _, h, w = images.shape
        phi = [images.expand(b, k, 3, h, w), at_pixels(lights).expand(b, k, 3, h, w).to(images.dtype)]
        if self.config.prior and not self.two:
            phi.insert(0, per_image(shared.prior, k).unflatten(0, (b, k)).to(images.dtype))
        phi = torch.cat(phi, dim=2).flatten(0, 1).contiguous(memory_format=torch.channels_last)  # (b k, 6 or 9, h, w)
        seen = self.image(phi)
        x = seen[-1]
        if self.prior is not None and self.config.exchange:
            x = per_image(shared.features, k)
            for scale, image in zip([*self.prior.scales[1:], nn.Identity()], seen, strict=True):
                x = scale(torch.cat([x, image], dim=1))
        return Pooled(over_images(x, k))

    def look(self, digested: Pooled, n: int, shared: Any) -> Float[Tensor, "b 3 h w"]:
        x = digested.maximum
        if self.prior is not None and not self.config.exchange:  # the maximum of what is the same in all images
            x = torch.cat([shared.features, x], dim=1)
        return self.regressor(x, shared.prior)


class Regressor(nn.Module):
    """Six convolutions, three deconvolutions, unit length: from a quarter of the resolution to twice it, then down."""

    def __init__(self, inputs: int, width: int, concat: int) -> None:
        super().__init__()
        self.concat = concat
        self.quarter_size = nn.Sequential(conv(inputs, 4 * width), deconv(4 * width, 2 * width))  # h/2
        self.half_size = nn.Sequential(conv(2 * width, 2 * width), deconv(2 * width, width))  # h
        self.full_size = nn.Sequential(conv(width + 3 * (concat == 2), width), deconv(width, width))  # 2h
        self.down = conv(width + 3 * (concat == 3), width, stride=2)  # h
        self.last = nn.Sequential(conv(width, width), nn.Conv2d(width, 3, 3, padding=1, bias=False))

    def forward(self, x: Float[Tensor, "b c i j"], prior: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
        x = self.half_size(self.quarter_size(x))
        x = self.full_size(torch.cat([x, prior.to(x.dtype)], dim=1) if self.concat == 2 else x)
        if self.concat == 3:
            twice = unit(F.interpolate(prior.float(), scale_factor=2, mode="bilinear", align_corners=False))
            x = torch.cat([x, twice.to(x.dtype)], dim=1)
        return unit(self.last(self.down(x)))


def per_image(x: Float[Tensor, "b c h w"], k: int) -> Float[Tensor, "bk c h w"]:
    """The same features for each of k images."""
    return x if k == 1 else x.repeat_interleave(k, dim=0)


def over_images(x: Float[Tensor, "bk c h w"], k: int) -> Float[Tensor, "b c h w"]:
    """Maximum over the images of each sample, in the order in which channels-last memory runs."""
    return pool(x.permute(0, 2, 3, 1).unflatten(0, (-1, k))).maximum.permute(0, 3, 1, 2)


@dataclass(frozen=True)
class LambertianPrior(Learned):
    """The paper's network (Ju et al., IEEE TIM 2021): least-squares normals guide a residual network.

    Parameters
    ----------
    weights, rotations : see Learned
    prior : a classical method in place of the one that the weights were learned with; "": that one
    """

    prior: str = ""
    name = "lambertian-prior"
