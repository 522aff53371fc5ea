"""Lights from photographs alone: after LCNet of SDPS-Net (Chen, Han, Shi, Matsushita, Wong, CVPR 2019).

Each image gives features, whose maximum over the images shows what the object is like; with both, each image shows its
light: direction and intensity as distributions over bins, whose means are between the bins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from photonormal.methods.inputs.grey import grey
from photonormal.methods.learned.layers import SLOPE, conv, kaiming
from photonormal.methods.learned.network import Model
from photonormal.methods.learned.pooling import pool

SIDE = 64  # pixels of the square that an object is reduced to
ANGLES = 36  # bins of either angle, over 180 degrees
INTENSITIES = 20  # bins of an intensity's logarithm
RANGE = 1.2  # of that logarithm, either side of the images' mean: factors of 3.3
RATIO = 4.0  # a sample over its pixel's root mean square is cut here


@dataclass(frozen=True)
class LightsConfig:
    """The network's switches.

    Parameters
    ----------
    width : channels of the first layer; twice and four times as many follow
    prior : always "": nothing enters but the photographs
    """

    width: int = 32
    prior: str = ""


class BinnedLights(NamedTuple):
    """What is found of the lights of k images: logarithms of shares of the bins, up to one number for each image.

    The first angle is atan(x / z), the second asin(y), both from -90 to 90 degrees.
    """

    across: Float[Tensor, "b k 36"]
    up: Float[Tensor, "b k 36"]
    intensity: Float[Tensor, "b k 20"]

    @property
    def directions(self) -> Float[Tensor, "b k 3"]:
        """Unit vectors, by the mean angles."""
        return direction(mean(self.across, math.pi / 2), mean(self.up, math.pi / 2))

    @property
    def log_intensities(self) -> Float[Tensor, "b k"]:
        """Natural logarithms of the intensities; their mean over the images is 0."""
        found = mean(self.intensity, RANGE)
        return found - found.mean(1, keepdim=True)

    @property
    def told_deg(self) -> Float[Tensor, "b k"]:
        """How wide the distributions of the angles are: their standard deviation together, degrees."""
        variance = [mean(x, math.pi / 2, power=2) - mean(x, math.pi / 2).square() for x in (self.across, self.up)]
        return torch.stack(variance).sum(0).clamp(min=0).sqrt().rad2deg()


class LightsNet(Model):
    """Scaled images (b, n, c, h, w) of whole objects, with their mask, to their lights; h and w are SIDE."""

    Config: ClassVar[type] = LightsConfig
    learns = "lights"
    scaling = "exposure"

    def __init__(self, config: LightsConfig = LightsConfig()) -> None:
        super().__init__()
        self.config = config
        w = config.width
        self.each = nn.Sequential(
            conv(3, w, stride=2), conv(w, 2 * w, stride=2), conv(2 * w, 2 * w), conv(2 * w, 4 * w, stride=2),
            conv(4 * w, 4 * w),
        )  # fmt: skip
        self.both = nn.Sequential(conv(8 * w, 4 * w), conv(4 * w, 4 * w, stride=2), conv(4 * w, 4 * w, stride=2))
        self.flat = nn.Sequential(nn.Linear(16 * w, 8 * w), nn.LeakyReLU(SLOPE))
        self.joined = nn.Sequential(nn.Linear(24 * w, 8 * w), nn.LeakyReLU(SLOPE))
        self.told = nn.Linear(8 * w, 2 * ANGLES + INTENSITIES)
        kaiming(self)

    def forward(self, images: Float[Tensor, "b n c h w"], mask: Bool[Tensor, "b 1 h w"]) -> BinnedLights:
        """The lights of n images, from `scaled` ones, zero outside the mask."""
        x = grey(images)  # (b, n, 1, h, w)
        rms = x.square().mean(1, keepdim=True).sqrt()
        ratio = (x / rms.clamp(min=1e-6)).clamp(max=RATIO)  # free of the albedo
        phi = torch.cat([x.sqrt(), ratio.sqrt(), mask[:, None].expand_as(x).to(x.dtype)], dim=2)
        n = phi.shape[1]
        each = self.each(phi.flatten(0, 1).contiguous(memory_format=torch.channels_last)).unflatten(0, (-1, n))
        common = pool(each).maximum[:, None].expand_as(each)  # (b, n, 4 width, h / 8, w / 8)
        both = torch.cat([each, common], dim=2).flatten(0, 1).contiguous(memory_format=torch.channels_last)
        f = self.flat(self.both(both).flatten(1)).unflatten(0, (-1, n))  # (b, n, 8 width)
        of_all = [v.expand_as(f) for v in (f.amax(1, keepdim=True), f.mean(1, keepdim=True))]
        told = self.told(self.joined(torch.cat([f, *of_all], dim=2))).float()
        return BinnedLights(*told.split([ANGLES, ANGLES, INTENSITIES], dim=-1))


def direction(across: Tensor, up: Tensor) -> Float[Tensor, "*b 3"]:
    """The unit vector of two angles."""
    return torch.stack([across.sin() * up.cos(), up.sin(), across.cos() * up.cos()], dim=-1)


def angles(L: Float[Tensor, "*b 3"]) -> tuple[Tensor, Tensor]:
    """The two angles of unit vectors."""
    return torch.atan2(L[..., 0], L[..., 2]), torch.asin(L[..., 1].clamp(-1, 1))


def centres(bins: int, end: float, like: Tensor) -> Float[Tensor, " bins"]:
    """Middles of bins of one width from -end to end."""
    return ((torch.arange(bins, device=like.device) + 0.5) * (2 / bins) - 1) * end


def mean(logits: Float[Tensor, "*b bins"], end: float, power: int = 1) -> Float[Tensor, "*b"]:
    """Mean of a power under the distribution over bins from -end to end."""
    return (logits.softmax(-1) * centres(logits.shape[-1], end, logits) ** power).sum(-1)


def between(value: Float[Tensor, "*b"], bins: int, end: float) -> Float[Tensor, "*b bins"]:
    """The distribution over two neighbouring bins whose mean a value is; at the ends, all in one."""
    place = ((value / end + 1) * (bins / 2) - 0.5).clamp(0, bins - 1)[..., None]
    return (1 - (torch.arange(bins, device=value.device) - place).abs()).clamp(min=0)


def told_wrong(told: BinnedLights, L: Float[Tensor, "b k 3"], log_e: Float[Tensor, "b k"]) -> dict[str, Any]:
    """What a training makes small, a mean over all images each.

    `angle` is the chord between directions, `intensity` the error of the logarithm, `bins` the cross-entropy.
    """
    log_e = log_e - log_e.mean(1, keepdim=True)
    wanted = [between(x, ANGLES, math.pi / 2) for x in angles(L)] + [between(log_e, INTENSITIES, RANGE)]
    bins = sum(-(w * x.log_softmax(-1)).sum(-1).mean() for w, x in zip(wanted, told, strict=True))
    chord = (told.directions - L).square().sum(-1)
    return {
        "angle": (chord + 1e-4).sqrt().mean(),
        "intensity": (told.log_intensities - log_e).abs().mean(),
        "bins": bins,
    }
