"""The layers that the convolutional networks share: convolutions, 4 x 4 deconvolutions, residual blocks.

LeakyReLU of slope 0.1 follows every layer but the last; no batch normalisation; Kaiming's initial weights, zero bias:
the practice of PS-FCN (Chen, Han, Wong, ECCV 2018) and of the networks that follow it.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

SLOPE = 0.1  # of LeakyReLU
BEGIN = 0.1  # of Kaiming's weights, with which a residual branch begins beside its shortcut


def conv(inputs: int, outputs: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    """Convolution of `size` x `size` with bias, LeakyReLU."""
    return nn.Sequential(nn.Conv2d(inputs, outputs, size, stride, padding=size // 2), nn.LeakyReLU(SLOPE, inplace=True))


def deconv(inputs: int, outputs: int) -> nn.Sequential:
    """4 x 4 transposed convolution without bias that doubles the resolution, LeakyReLU."""
    return nn.Sequential(
        nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1, bias=False), nn.LeakyReLU(SLOPE, inplace=True)
    )


class Block(nn.Module):
    """Two convolutions, the first with a stride; residual: plus a shortcut (1 x 1 where the shape changes)."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1, residual: bool = True, size: int = 3) -> None:
        super().__init__()
        self.first = conv(inputs, outputs, stride, size)
        self.second = nn.Conv2d(outputs, outputs, size, padding=size // 2)
        same = stride == 1 and inputs == outputs
        self.residual = residual
        self.shortcut = None if same or not residual else nn.Conv2d(inputs, outputs, 1, stride, bias=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d i j"]:
        y = self.second(self.first(x))
        if self.residual:
            y = y + (x if self.shortcut is None else self.shortcut(x))
        return F.leaky_relu(y, SLOPE, inplace=not self.residual or not torch.is_grad_enabled())


def kaiming(network: nn.Module) -> None:
    """Kaiming's normal initial weights (fan in, gain of ReLU) and zero biases, in every convolution.

    A residual branch begins small: else each block adds to the variance of what passes through it.
    """
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.kaiming_normal_(module.weight)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
    for module in network.modules():
        if isinstance(module, Block) and module.residual:
            module.second.weight.data.mul_(BEGIN)


def unit(x: Float[Tensor, "*maps"], axis: int = 1) -> Float[Tensor, "*maps"]:
    """Unit length over an axis, in float32; the L2 layer that ends every network. Zero stays zero.

    As torch's own `normalize`, which takes eighty times as long where the axis is not the last in memory.
    """
    x = x.float()
    return x / x.square().sum(axis, keepdim=True).clamp(min=1e-24).sqrt()
