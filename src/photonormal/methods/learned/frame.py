"""A pixel's own frame: lights turned about the view axis until the prior's azimuth is zero; what an image shows in it.

Images run last, after the pixels: what is pooled over them then lies together.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from photonormal.methods.learned.layers import SLOPE
from photonormal.methods.learned.network import at_pixels
from photonormal.methods.learned.processor import exactly, of_rows

TOKENS = 16  # numbers per image and pixel, see `tokens`


class PriorFrame(NamedTuple):
    """Where each pixel's prior points; each (b, h, w)."""

    c: Tensor  # cosine and sine of the angle that is turned away
    s: Tensor
    x: Tensor  # the turned prior, unit
    y: Tensor  # zero where turned
    z: Tensor

    @staticmethod
    def of(prior: Float[Tensor, "b 3 h w"]) -> PriorFrame:
        """Of normals; what is zero faces the camera."""
        known = prior.square().sum(1, keepdim=True) > 0.25
        x, y, z = torch.where(known, prior, prior.new_tensor([0.0, 0.0, 1.0])[:, None, None]).float().unbind(1)
        z = z.clamp(min=0.05)  # a surface that is seen looks towards the camera
        r = torch.sqrt(x * x + y * y)
        c, s = torch.where(r > 1e-6, x / r, 1.0), torch.where(r > 1e-6, y / r, 0.0)
        x, y = c * x + s * y, c * y - s * x
        length = torch.sqrt(x * x + y * y + z * z)
        return PriorFrame(c, s, x / length, y / length, z / length)

    def in_picture(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """x and y (b, h, w) in the picture's axes."""
        return self.c * x - self.s * y, self.s * x + self.c * y


class SharedFrame(NamedTuple):
    """What all images of a pixel share."""

    frame: PriorFrame
    shading: Tensor | None  # (b, h, w) root mean square of max(n.l, 0) of the prior over all lights
    recalled: Tensor | None = None  # (b, h, w, hidden) what an earlier pass hands to the encoder


def lights_in_frame(
    lights: Float[Tensor, "b k 3 *hw"], frame: PriorFrame
) -> tuple[tuple[Tensor, Tensor, Tensor], Tensor]:
    """Each pixel's turned lights, x, y, z of (b, h, w, k), and their cosines with the prior (b, h, w, k)."""
    c, s, nx, ny, nz = (v[..., None] for v in frame)
    x, y, z = at_pixels(lights).float().permute(2, 0, 3, 4, 1)  # (b, 1 or h, 1 or w, k)
    x, y = c * x + s * y, c * y - s * x  # (b, h, w, k)
    return (x, y, z), nx * x + ny * y + nz * z


def shading(lights: Float[Tensor, "b n 3 *hw"], frame: PriorFrame) -> Float[Tensor, "b h w"]:
    """Root mean square of max(n.l, 0) of the prior, at least 0.05."""
    total, N = torch.zeros_like(frame.z), torch.stack([*frame.in_picture(frame.x, frame.y), frame.z], dim=-1)
    with exactly(N.device):
        for some in lights.float().split(32, dim=1):
            if some.ndim == 3:
                cos = (N.flatten(1, 2) @ some.mT).unflatten(1, N.shape[1:3])  # (b, h, w, k)
            else:
                cos = torch.einsum("bhwc,bkchw->bhwk", N, some)
            total += cos.clamp_(min=0).square_().sum(-1)
    return (total / lights.shape[1]).sqrt().clamp(min=0.05)


def tokens(
    I: Float[Tensor, "b k h w"], lights: Float[Tensor, "b k 3 *hw"], shared: SharedFrame
) -> Float[Tensor, "16 b h w k"]:
    """What is known of an image at a pixel, in the pixel's frame.

    The observation (over the pixel's root mean square) and what it exceeds the prior's shading by, both also as
    logarithms; the turned light and half vector; their cosines with the prior, the latter also magnified near a
    highlight; whether the prior sees the light; the prior itself. (Matrices of 16 columns are several times faster
    than of 8.)
    """
    assert shared.shading is not None
    I = I.permute(0, 2, 3, 1)
    (x, y, z), cos = lights_in_frame(lights, shared.frame)
    nx, nz = (v[..., None].expand_as(x) for v in (shared.frame.x, shared.frame.z))
    s = torch.rsqrt((2 + 2 * z).clamp(min=1e-6))  # 1 / |l + v|; a light may come from right behind
    half = (cos + nz) * s  # n.h
    shade = cos.clamp(min=0) / shared.shading[..., None]
    log = torch.log1p(20 * I) / 2 - 1
    excess = log - (torch.log1p(20 * shade) / 2 - 1)
    z, s = z.expand_as(x), s.expand_as(x)
    near, sees = 10 * (half - 0.9).clamp(min=-0.1), (cos > 0).to(cos.dtype)
    h = [x * s, y * s, (z + 1) * s]
    return torch.stack([I, I - shade, log, excess, x, y, z, *h, cos, half, near, sees, nx, nz])


class Encoder(nn.Sequential):
    """Each image of a pixel by itself; what an earlier pass found joins it in the first layer.

    That layer computes in float32 on any machine: bf16 would round what it reads, and dark pictures most.
    """

    def __init__(self, hidden: int, features: int) -> None:
        act = nn.LeakyReLU(SLOPE, inplace=True)
        super().__init__(
            nn.Linear(TOKENS, hidden), act, nn.Linear(hidden, hidden), act, nn.Linear(hidden, features), act
        )

    def read(
        self, seen: Float[Tensor, "t b h w k"], recalled: Float[Tensor, "b h w hidden"] | None
    ) -> Float[Tensor, "bhw k features"]:
        first, act, second, _, third, _ = self
        assert isinstance(second, nn.Linear) and isinstance(third, nn.Linear)
        with exactly(seen.device):
            x = first(seen.flatten(1).T)  # in two axes: views would make every in-place layer copy
            if recalled is not None:
                x = (x.unflatten(0, (-1, seen.shape[-1])) + recalled.flatten(0, 2)[:, None]).flatten(0, 1)
        x = act(of_rows(third, act(of_rows(second, act(x)))))
        return x.unflatten(0, (-1, seen.shape[-1]))
