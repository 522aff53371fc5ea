"""SPLINE-Net: Q. Zheng, Y. Jia, B. Shi, X. Jiang, L.-Y. Duan, A. Kot, ICCV 2019, which fills the gaps between lights.

The paper is "SPLINE-Net: Sparse photometric stereo through lighting interpolation and normal estimation networks".

Few lights: one network fills the gaps of a pixel's observation map, another finds the normal from both maps. While they
learn, the first is shown some of a pixel's samples and has to predict all of them (`photonormal.train.objective`). The
paper takes turns between the two networks, and renders full maps for the first; here both learn in every step, from
the samples that other networks learn from.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.methods.inputs.maps import disc, mirrored, seen_from_above
from photonormal.methods.learned.layers import kaiming
from photonormal.methods.learned.maps import MapNetwork, OfMaps
from photonormal.methods.learned.pooling import Pooled
from photonormal.types import InputError

FEWEST = 4  # samples that it is shown while it learns
POOLED = 4  # cells that the asymmetric loss takes the brightest of, across and up
ASYMMETRIC = (1e-3, 50.0)  # its weight beside the symmetric loss, and that of pooled maps in it


@dataclass(frozen=True)
class SPLINENetConfig:
    """The networks' switches; the defaults are the paper's.

    Parameters
    ----------
    side : of an observation map, in cells
    width : channels of the first layer that interpolates; twice and four times as many follow
    blocks : residual ones at a quarter of the map's side
    grown : channels that each convolution of the dense network adds
    hidden : width of the layer before the normal
    prior : always "": no classical method enters
    """

    side: int = 32
    width: int = 64
    blocks: int = 6
    grown: int = 16
    hidden: int = 128
    prior: str = ""

    def __post_init__(self) -> None:
        if self.side % 4:
            raise InputError(f"side {self.side} came but spline-net halves its maps twice; give a multiple of 4.")


class SPLINENet(MapNetwork):
    """Observation maps of grey levels with gaps, and the same without, to unit normals."""

    Config: ClassVar[type] = SPLINENetConfig
    teaches = "maps"

    def __init__(self, config: SPLINENetConfig = SPLINENetConfig()) -> None:
        super().__init__(config, channels=2)
        self.interpolation = Interpolator(config.width, config.blocks)

    def projection(self, L: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 2"]:
        return seen_from_above(L)

    def read(self, maps: Float[Tensor, "q s s"]) -> Float[Tensor, "q 2 s s"]:
        D = self.interpolation(maps[:, None])[:, 0].to(maps) * disc(self.side, maps.device)
        return torch.stack([maps, D], dim=1)

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        return super().encode(images * some(images) if self.training else images, lights, shared)

    def teach(
        self, images: Float[Tensor, "b n c h w"], lights: Float[Tensor, "b n 3 *hw"], digested: Any, N: Tensor
    ) -> Float[Tensor, "b 2 h w"]:
        def maps(samples: Tensor) -> Float[Tensor, "q s s"]:
            return super(SPLINENet, self).encode(samples, lights, None).maximum.flatten(0, 3)

        D = digested[..., 3:].flatten(0, 2).unflatten(1, (self.side, self.side))  # (q, s, s)
        shown = some(images)
        read, brightest = maps(shown), maps(images * shown).amax((1, 2), keepdim=True).clamp(min=1e-9)
        wrong = (D - (maps(images) / brightest).clamp(max=1)).abs()
        wrong = mean_where(wrong, maps(torch.ones_like(images))) + mean_where(wrong, read)
        taught = torch.stack([wrong, asymmetry(D, N.permute(0, 2, 3, 1).flatten(0, 2))], dim=1)  # (q, 2)
        return taught.unflatten(0, digested.shape[:3]).permute(0, 3, 1, 2)


def some(images: Float[Tensor, "b k 1 h w"]) -> Float[Tensor, "b k 1 h w"]:
    """1 where a sample is shown, else 0: of each pixel the first, FEWEST to all, about evenly on a log scale."""
    b, k, _, h, w = images.shape
    share = torch.arange(b * h * w, device=images.device) * 0.618 % 1  # of neighbouring pixels: far apart
    count = ((1 - share) * log(min(FEWEST, k)) + share * log(k)).exp().round().view(b, 1, 1, h, w)
    return (torch.arange(k, device=images.device)[:, None, None, None] < count).to(images)


def mean_where(x: Float[Tensor, "q s s"], where: Float[Tensor, "q s s"]) -> Float[Tensor, " q"]:
    """The mean of a map's cells that are lit."""
    return (x * where).sum((1, 2)) / where.sum((1, 2)).clamp(min=1)


def asymmetry(D: Float[Tensor, "q s s"], N: Float[Tensor, "q 3"]) -> Float[Tensor, " q"]:
    """What maps are off their mirror images about the normal: by the symmetric loss little, by the asymmetric not none.

    An isotropic surface shows the same to lights that mirror each other, where no shadow or second bounce enters.
    The paper sums over a map's cells; this is the mean.
    """
    weight, of_pooled = ASYMMETRIC
    cells = D[0].numel()
    off = (D - mirrored(D, N)).abs().mean((1, 2))
    P = F.max_pool2d(D[:, None], POOLED)[:, 0]
    pooled_off = (P - mirrored(P, N)).abs().mean((1, 2))
    return off + weight * ((off - 1 / cells).abs() + of_pooled * (pooled_off - 1 / P[0].numel()).abs())


class Interpolator(nn.Module):
    """A map with gaps to one without, cells from 0 to 1: two strides down, residual blocks, two strides up."""

    def __init__(self, width: int, blocks: int) -> None:
        super().__init__()
        w = width
        self.layers = nn.Sequential(
            nn.Conv2d(1, w, 7, padding=3), *norm_and_relu(w),
            nn.Conv2d(w, 2 * w, 4, 2, padding=1), *norm_and_relu(2 * w),
            nn.Conv2d(2 * w, 4 * w, 4, 2, padding=1), *norm_and_relu(4 * w),
            *(Residual(4 * w) for _ in range(blocks)),
            nn.ConvTranspose2d(4 * w, 2 * w, 4, 2, padding=1), *norm_and_relu(2 * w),
            nn.ConvTranspose2d(2 * w, w, 4, 2, padding=1), *norm_and_relu(w),
            nn.Conv2d(w, 1, 7, padding=3),
        )  # fmt: skip
        kaiming(self)

    def forward(self, maps: Float[Tensor, "q 1 s s"]) -> Float[Tensor, "q 1 s s"]:
        return torch.sigmoid(self.layers(maps.contiguous(memory_format=torch.channels_last)))


class Residual(nn.Module):
    """Two convolutions of 3 x 3, each with instance normalisation, plus what came."""

    def __init__(self, width: int) -> None:
        super().__init__()
        first, second = (nn.Conv2d(width, width, 3, padding=1) for _ in range(2))
        self.layers = nn.Sequential(first, *norm_and_relu(width), second, norm_and_relu(width)[0])

    def forward(self, x: Float[Tensor, "q c i j"]) -> Float[Tensor, "q c i j"]:
        return x + self.layers(x)


def norm_and_relu(width: int) -> tuple[nn.Module, nn.Module]:
    """Instance normalisation and ReLU, which follow a convolution."""
    return nn.InstanceNorm2d(width), nn.ReLU()


@dataclass(frozen=True)
class SPLINENetMethod(OfMaps):
    """SPLINE-Net (Zheng et al., ICCV 2019): each pixel by itself, from its observation map whose gaps are filled first.

    Made for few lights, ten in the paper.

    Parameters
    ----------
    weights, turns : see OfMaps
    """

    name = "spline-net"
