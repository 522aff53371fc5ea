"""Attention-PSN (Ju, Lam, Chen, Qi, Dong, IJCAI 2020): at an object's edges it learned from changes of normals.

A deep residual network takes the place of PS-FCN's extractor. Beside it a small one finds from the edges of the images
how much each pixel is an edge; it decides what is learned (`photonormal.train.objective`), and does not measure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.methods.inputs.edges import gradient
from photonormal.methods.inputs.grey import grey
from photonormal.methods.learned.lambertian_prior import over_images
from photonormal.methods.learned.layers import SLOPE, conv, deconv, kaiming
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.psfcn import FusedNetwork

BEGIN = 0.1  # of Kaiming's weights, with which a bottleneck begins beside its shortcut


@dataclass(frozen=True)
class AttentionPSNConfig:
    """The network's switches; the defaults are the paper's: 118 layers, as in ResNet-152, and 512 channels fused.

    ResNet-152 has 1,024 channels there, so both do not go together; here all bottlenecks after the third give 512.

    Parameters
    ----------
    width : channels within the first bottlenecks; four and eight times as many leave those at half and at a quarter
    shallow, deep : bottlenecks of three layers at half and at a quarter of the resolution
    prior : always "": no classical method enters
    """

    width: int = 64
    shallow: int = 3
    deep: int = 36
    prior: str = ""


class AttentionPSNNet(FusedNetwork):
    """Scaled images (b, n, 3, h, w) and lights (b, n, 3) to unit normals (b, 3, h, w); sizes are multiples of 4."""

    Config: ClassVar[type] = AttentionPSNConfig
    scaling = "exposure"
    stride = 4
    teaches = "attention"

    def __init__(self, config: AttentionPSNConfig = AttentionPSNConfig()) -> None:
        super().__init__()
        self.config = config
        w = config.width
        self.extractor = nn.Sequential(
            conv(6, w, stride=2, size=7),
            *bottlenecks(w, 4 * w, w, config.shallow, stride=1),
            *bottlenecks(4 * w, 8 * w, 2 * w, config.deep, stride=2),
        )
        self.regressor = nn.Sequential(
            conv(8 * w, 4 * w), deconv(4 * w, 2 * w), deconv(2 * w, w), nn.Conv2d(w, 3, 3, padding=1, bias=False)
        )
        self.attention = Attention(2 * w)
        around = 3 + 2 * config.shallow + 4 * config.deep + 4 + 6 + 3 + 1  # of each layer, in pixels
        self.reach = -(-around // self.stride) * self.stride
        kaiming(self)
        for module in self.modules():
            if isinstance(module, Bottleneck):
                module.last.weight.data.mul_(BEGIN)

    def teach(
        self, images: Float[Tensor, "b n c h w"], lights: Float[Tensor, "b n 3 *hw"], digested: Any, N: Tensor
    ) -> Float[Tensor, "b 1 h w"]:
        return self.attention(images)


class Attention(nn.Module):
    """How much each pixel is an edge, [0, 1], from the images' own: the most that any of them shows."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.each = nn.Sequential(conv(2, width), conv(width, width), conv(width, width))
        self.all = nn.Sequential(conv(width, width), conv(width, width), nn.Conv2d(width, 1, 3, padding=1))

    def forward(self, images: Float[Tensor, "b n c h w"]) -> Float[Tensor, "b 1 h w"]:
        edges = gradient(grey(images)[:, :, 0]).permute(1, 2, 0, 3, 4).flatten(0, 1)  # (b n, 2, h, w)
        x = self.each(edges.contiguous(memory_format=torch.channels_last))
        x = self.all(over_images(x, images.shape[1])).float()
        least, most = x.amin((2, 3), keepdim=True), x.amax((2, 3), keepdim=True)
        return (x - least) / (most - least).clamp(min=1e-6)


class Bottleneck(nn.Module):
    """ResNet's: 1 x 1, 3 x 3 of `inner` channels, 1 x 1, plus a shortcut (1 x 1 where the shape changes)."""

    def __init__(self, inputs: int, outputs: int, inner: int, stride: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(conv(inputs, inner, size=1), conv(inner, inner, stride))
        self.last = nn.Conv2d(inner, outputs, 1)
        same = stride == 1 and inputs == outputs
        self.shortcut = nn.Identity() if same else nn.Conv2d(inputs, outputs, 1, stride, bias=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d i j"]:
        return F.leaky_relu(self.last(self.inner(x)) + self.shortcut(x), SLOPE)


def bottlenecks(inputs: int, outputs: int, inner: int, count: int, stride: int) -> list[Bottleneck]:
    """So many at one resolution, the first with a stride."""
    first = Bottleneck(inputs, outputs, inner, stride)
    return [first, *(Bottleneck(outputs, outputs, inner, 1) for _ in range(count - 1))]


@dataclass(frozen=True)
class AttentionPSN(Learned):
    """Attention-PSN (Ju, Lam, Chen, Qi, Dong, IJCAI 2020): learned with a loss that heeds edges; no prior."""

    name = "attention-psn"
