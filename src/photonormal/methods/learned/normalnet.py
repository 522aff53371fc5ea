"""The default, our network: a classical prior gives each pixel its frame; it reads its images, then looks around.

Fed as plain features a prior is copied, its bias included; as a frame it isn't. Each pixel's lights are turned about
the view axis until the prior's azimuth is zero, so that one isotropic material looks the same from every side and a
whole degree of freedom need not be learned. A shared encoder reads each image of a pixel; mean and maximum over the
images, and means that weigh each image by what is seen in it; 3 x 3 layers at full resolution; a correction is added
to the prior. Untrained it returns its prior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from photonormal.methods.contract import Observations
from photonormal.methods.learned.around import Level, QuarterView, Refine, begun, starting_at, with_quarter
from photonormal.methods.learned.frame import Encoder, PriorFrame, SharedFrame, shading, tokens
from photonormal.methods.learned.layers import SLOPE, Block, conv, unit
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.network import PixelNetwork, Step
from photonormal.methods.learned.pooling import Pooled, pool, weighted_sum
from photonormal.methods.learned.processor import exactly, of_rows
from photonormal.methods.uncalibrated.evened import brightened
from photonormal.options import Effort
from photonormal.types import InputError

WEIGHT = 4.0  # logarithm of the largest weight of an image in a weighted mean; the least is its inverse
POLISH = 64  # channels of the layers that correct the normals in the picture's axes
SMALL = 1e-3  # deviation of weights that start near zero: what the network returns is its prior
DOUBT = 32  # channels of the layer that gives the expected error
LEAST_DEG = 0.3  # expected error; a true one over an expected one of nearly nothing would swamp all other gradients


@dataclass(frozen=True)
class NormalNetConfig:
    """The network's switches; the defaults are those of the weights that ship, 3.649 million parameters.

    Parameters
    ----------
    prior : the classical method that gives the frame
    hidden, features : channels of the encoder's first two layers, and of its last
    width, layers : channels and number of the 3 x 3 layers before the last one
    expected : also give the expected angular error of each normal
    memory : channels that a pass hands to the next one beside its normals, for the encoder to look at each image
        with what was learned from the others
    coarse : layers at a quarter of the resolution, which see 20 pixels around; 0: none
    far : residual blocks at an eighth of the resolution, two see 80 pixels around; 0: none; only with `coarse`
    attention : groups of features, each with a mean over the images weighted by a learned score beside the even one;
        after the first pass the scores know, by its memory, what the other images show; 0: none
    compass : show the layers that look around where each prior points in the picture, not only how it slants, so that
        neighbours can be compared (a bump from a hollow); and polish the normals in the picture's axes
    level : bring a pixel's features to one root mean square wherever the network begins to look around
    """

    prior: str = "trimmed"
    hidden: int = 64
    features: int = 128
    width: int = 128
    layers: int = 2
    expected: bool = True
    memory: int = 32
    coarse: int = 2
    far: int = 2
    attention: int = 4
    level: bool = True
    compass: bool = True


class NormalNet(PixelNetwork):
    """Grey images (b, n, 1, h, w) over their root mean square, lights (b, n, 3), prior (b, 3, h, w) to unit normals."""

    Config: ClassVar[type] = NormalNetConfig
    scaling = "grey"
    exact = True

    def __init__(self, config: NormalNetConfig = NormalNetConfig()) -> None:
        super().__init__()
        self.config = c = config
        if c.far and not c.coarse:
            raise InputError(f"far={c.far} came with coarse=0 but what is far is seen through it; set coarse.")
        self.memory = c.memory
        self.encoder = Encoder(c.hidden, c.features)
        self.fuse = Fuse(2 * c.features + 3 + 2 * c.compass, c.width)
        if c.attention:
            self.score = nn.Linear(c.features, c.attention)
            self.heed = starting_at(0.0, nn.Linear(c.features, c.width, bias=False))
        self.level = Level() if c.level else nn.Identity()
        self.spatial = nn.Sequential(*[conv(c.width, c.width) for _ in range(c.layers)])
        self.correction = starting_at(SMALL, nn.Conv2d(c.width, 3, 3, padding=1))
        self.coarse = QuarterView(c.width, c.coarse, c.far, self.level) if c.coarse else None
        self.finish = Refine(c.width, self.level) if c.far else None
        if c.compass:
            last = starting_at(SMALL, nn.Conv2d(POLISH, 3, 3, padding=1))
            self.polish = nn.Sequential(conv(c.width + 3, POLISH), conv(POLISH, POLISH), last)
        if c.memory:
            self.remember = nn.Conv2d(c.width, c.memory, 1)
            self.recall = starting_at(0.0, nn.Linear(c.memory, c.hidden, bias=False))
        if c.expected:
            self.doubt = nn.Sequential(conv(c.width + 4, DOUBT), nn.Conv2d(DOUBT, 1, 3, padding=1))
        self.stride = self.coarse.stride if self.coarse else 1
        if not self.correction.weight.is_meta:  # else the weights come from a file
            self.initialise()

    def initialise(self) -> None:
        """Random weights with which the network returns its prior."""
        for module in self.modules():
            if isinstance(module, nn.Linear | nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, a=SLOPE)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
            if isinstance(module, Block):  # a branch starts small beside its shortcut
                module.second.weight.data.mul_(0.3)
        for weight, std in begun(self):
            nn.init.normal_(weight, std=std) if std else nn.init.zeros_(weight)

    def begin(self, prior: Float[Tensor, "b c h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> SharedFrame:
        frame, memory = PriorFrame.of(prior[:, :3]), prior[:, 3:]
        if lights is None:
            return SharedFrame(frame, None)
        with exactly(prior.device):
            recalled = self.recall(memory.permute(0, 2, 3, 1)) if memory.shape[1] else None
        return SharedFrame(frame, shading(lights, frame), recalled)

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        features = self.encoder.read(tokens(images[:, :, 0], lights, shared), shared.recalled)  # (b h w, k, features)
        pooled = pool(features, total=True)  # (b h w, features)
        if self.config.attention:
            w = (WEIGHT * torch.tanh(self.score(features) / WEIGHT)).exp().to(features.dtype)  # (b h w, k, groups)
            pooled = Pooled(*pooled[:2], weighted_sum(features, w), w.sum(1, dtype=torch.float32))
        return Pooled(*(None if x is None else x.unflatten(0, shared.frame.z.shape) for x in pooled))  # type: ignore[arg-type]

    def digest(self, pooled: Pooled, n: int, shared: Any) -> Float[Tensor, "b h w c"]:
        assert pooled.total is not None
        frame = shared.frame
        mean = (pooled.total / n).to(pooled.maximum.dtype)
        known = [frame.x, frame.y, frame.z]
        if self.config.compass:
            known += frame.in_picture(frame.x, frame.y)
        told = torch.stack(known, dim=-1).to(mean.dtype)
        x = torch.cat([pooled.maximum, mean, told], dim=-1)  # (b, h, w, features)
        heeded: Tensor | float = 0.0
        if pooled.weighted is not None and pooled.weights is not None:
            groups = pooled.weighted.unflatten(-1, (pooled.weights.shape[-1], -1))  # (b, h, w, g, f / g)
            means = groups / pooled.weights[..., None]
            heeded = of_rows(self.heed, means.flatten(-2).to(mean.dtype))
        return self.fuse.together(x, heeded)

    def maps(self, digested: Float[Tensor, "b h w c"], shared: SharedFrame) -> dict[str, Tensor]:
        frame = torch.stack(shared.frame, dim=1)  # (b, 5, h, w)
        return {"digested": digested.permute(0, 3, 1, 2), "frame": frame}  # channels last in memory

    def steps(self, n: int) -> list[Step]:
        c, coarse = self.config, self.coarse
        sees = 2 * (self.finish is not None) + 1 + max(2 * c.expected, 3 * c.compass)  # 3 x 3 each
        near = Step("near", ("digested",), lambda x: self.spatial(self.level(x)), reach=c.layers)
        if coarse is None:
            return [near, Step("told", ("near", "frame"), lambda x, frame: self.tell(x, frame, n), reach=sees)]
        sees = -(-(sees + 2) // 4) * 4  # joined to what is around
        return [
            near,
            *coarse.steps("near", "around"),
            Step(
                "told",
                ("near", "around", "frame"),
                lambda x, y, frame: self.tell(with_quarter(x, y), frame, n),
                reach=sees,
            ),
        ]

    def tell(self, x: Float[Tensor, "b c h w"], known: Float[Tensor, "b 5 h w"], n: int) -> Float[Tensor, "b d h w"]:
        """From what was seen around to unit normals, memory and expected errors."""
        frame = PriorFrame(*known.unbind(1))
        if self.finish is not None:
            x = self.finish(x)
        x = self.level(x)
        correction = self.correction(x).float()
        n_x, n_y, n_z = (known[:, 2:] + correction).unbind(1)
        N = unit(torch.stack([*frame.in_picture(n_x, n_y), n_z], dim=1))
        if self.config.compass:
            N = unit(N + self.polish(torch.cat([x, N.to(x.dtype)], dim=1)).float())
        if self.config.memory:
            N = torch.cat([N, self.remember(x).float()], dim=1)
        if not self.config.expected:
            return N
        few = torch.full_like(n_z, n)[:, None].log()
        seen = torch.cat([x, correction.to(x.dtype), few.to(x.dtype)], dim=1).detach()  # doubt changes no normal
        return torch.cat([N, (LEAST_DEG + self.doubt(seen).float().exp()).clamp(max=90)], dim=1)


class Fuse(nn.Sequential):
    """What all images of a pixel showed, and what was heeded of it."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__(nn.Linear(inputs, width), nn.LeakyReLU(SLOPE, inplace=True))

    def together(self, x: Float[Tensor, "b h w c"], heeded: Tensor | float) -> Float[Tensor, "b h w d"]:
        linear, act = self
        assert isinstance(linear, nn.Linear)
        return act(of_rows(linear, x) + heeded)


@dataclass(frozen=True)
class NormalNetMethod(Learned):
    """normalnet: a classical prior as the frame of a per-pixel network that then looks around.

    Parameters
    ----------
    weights, rotations : see Learned
    prior : a classical method in place of the one that the weights were learned with; "": that one
    passes : how often the network looks; from the second time on its own normals are the prior
    fast : the network looks at half the resolution, and a classical method keeps the detail
    even : pictures that are clearly brighter or darker than their lights' intensities say are divided by that first
    """

    prior: str = ""
    passes: Effort = 2
    fast: bool = False
    even: bool = True
    name = "normalnet"
    exact = NormalNet.exact

    def brightened(self, seen: Callable[[], Observations]) -> Tensor | None:
        """By the object's own shading, where that is certain."""
        return brightened(seen()) if self.even else None
