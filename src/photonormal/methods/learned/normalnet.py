"""A classical prior as the frame of a network: a pixel reads its own images first, then looks around (normalnet).

Fed as plain features a prior is copied, its bias included; as a frame it isn't. Each pixel's lights are turned about
the view axis until the prior's azimuth is zero, so that one isotropic material looks the same from every side and a
whole degree of freedom need not be learned. A shared encoder reads each image of a pixel; mean and maximum over the
images, and means that weigh each image by what is seen in it; 3 x 3 layers at full resolution; a correction is added
to the prior. Untrained it returns its prior.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.methods.learned.layers import SLOPE, Block, conv
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.network import Network, at_pixels
from photonormal.methods.learned.pooling import Pooled, pool, weighted_sum
from photonormal.methods.learned.weights import load
from photonormal.options import Effort
from photonormal.types import InputError

TOKENS = 16  # numbers per image and pixel, see `tokens`
FAR = 192  # channels at an eighth of the resolution
WEIGHT = 4.0  # logarithm of the largest weight of an image in a weighted mean; the least is its inverse
POLISH = 64  # channels of the layers that correct the normals in the picture's axes
SMALL = 1e-3  # deviation of weights that start near zero: what the network returns is its prior
DOUBT = 32  # channels of the layer that tells the expected error
LEAST_DEG = 0.3  # expected error; a true one over an expected one of nearly nothing would swamp all other gradients

M = TypeVar("M", bound=nn.Module)


@dataclass(frozen=True)
class NormalNetConfig:
    """The network's switches; the defaults are those of the weights that ship, 3.649 million parameters.

    Parameters
    ----------
    prior : the classical method that gives the frame
    hidden, features : channels of the encoder's first two layers, and of its last
    width, layers : channels and number of the 3 x 3 layers before the last one
    expected : also tell the expected angular error of each normal
    memory : channels that a pass hands to the next one beside its normals, for the encoder to look at each image
        with what was learned from the others
    coarse : layers at a quarter of the resolution, which see 20 pixels around; 0: none
    far : residual blocks at an eighth of the resolution, two see 80 pixels around; 0: none; only with `coarse`
    attention : groups of features, each with a mean over the images weighted by a learned score beside the even one;
        after the first pass the scores know, by its memory, what the other images show; 0: none
    compass : tell the layers that look around where each prior points in the picture, not only how it slants, so that
        neighbours can be compared (a bump from a hollow); and polish the normals in the picture's axes
    level : bring a pixel's features to one root mean square wherever the network begins to look around
    """

    RETIRED: ClassVar[dict[str, object]] = {"turn": True, "tilt": False, "blocks": 0}  # in weights files, always so

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


class Shared(NamedTuple):
    """What all images of a pixel share."""

    azimuth: tuple[Tensor, Tensor]  # cosine and sine (b, 1, h, w) of the angle that is turned away
    slant: tuple[Tensor, Tensor]  # x and z (b, 1, h, w) of the turned prior
    y: Tensor  # (b, 1, h, w), zero where turned
    shading: Tensor  # (b, 1, h, w) root mean square of max(n.l, 0) of the prior over all lights
    recalled: Tensor | None = None  # (b, h, w, hidden) what an earlier pass tells the encoder

    def rows(self, some: slice) -> Shared:
        """The same of some rows of pixels."""
        c, s, nx, nz, y, shading = (v[:, :, some] for v in (*self.azimuth, *self.slant, self.y, self.shading))
        recalled = None if self.recalled is None else self.recalled[:, some]
        return Shared((c, s), (nx, nz), y, shading, recalled)


class NormalNet(Network):
    """Grey images (b, n, 1, h, w) over their root mean square, lights (b, n, 3), prior (b, 3, h, w) to unit normals."""

    Config: ClassVar[type] = NormalNetConfig
    scaling = "grey"
    stride = 1
    pointwise = True

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
        self.coarse = Coarse(c.width, c.coarse, c.far, self.level) if c.coarse else None
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
        around = sum(part.reach for part in (self.coarse, self.finish) if part is not None)
        around += c.layers + 1 + max(2 * c.expected, 3 * c.compass)  # 3 x 3 each, the correction among them
        self.reach = -(-around // self.stride) * self.stride
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

    def begin(self, prior: Float[Tensor, "b c h w"], lights: Float[Tensor, "b n 3 *hw"]) -> Shared:
        prior, memory = prior[:, :3], prior[:, 3:]
        recalled = self.recall(memory.permute(0, 2, 3, 1)) if memory.shape[1] else None
        known = prior.square().sum(1, keepdim=True) > 0.25
        x, y, z = torch.where(known, prior, prior.new_tensor([0.0, 0.0, 1.0])[:, None, None]).float().split(1, dim=1)
        z = z.clamp(min=0.05)  # a surface that is seen looks towards the camera
        r = torch.sqrt(x * x + y * y)
        c, s = torch.where(r > 1e-6, x / r, 1.0), torch.where(r > 1e-6, y / r, 0.0)
        x, y = c * x + s * y, c * y - s * x
        length = torch.sqrt(x * x + y * y + z * z)
        shared = Shared((c, s), (x / length, z / length), y / length, torch.ones_like(c), recalled)
        total = torch.zeros_like(c)
        for light in lights.split(32, dim=1):
            total += cosines(light, shared)[1].clamp(min=0).square().sum(1, keepdim=True)
        return shared._replace(shading=(total / lights.shape[1]).sqrt().clamp(min=0.05))

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        seen = tokens(images[:, :, 0], lights, shared)  # (b, k, h, w, 16)
        features = self.encoder.read(seen, shared.recalled)  # (b k h w, features)
        pooled = pool(features.unflatten(0, seen.shape[:4]), total=True)  # (b, h, w, features)
        if not self.config.attention:
            return pooled
        features = features.unflatten(0, (*seen.shape[:2], -1))  # (b, k, h w, f)
        w = (WEIGHT * torch.tanh(self.score(features) / WEIGHT)).exp()  # (b, k, h w, groups)
        w = w.to(features.dtype)
        sums = weighted_sum(features, w), w.sum(1, dtype=torch.float32)
        return Pooled(pooled.maximum, pooled.total, *(x.unflatten(1, seen.shape[2:4]) for x in sums))

    def digest(self, pooled: Pooled, n: int, shared: Any) -> Float[Tensor, "b h w c"]:
        assert pooled.total is not None
        (c, s), (nx, nz), ny = shared.azimuth, shared.slant, shared.y
        mean = (pooled.total / n).to(pooled.maximum.dtype)
        known = [nx, ny, nz]
        if self.config.compass:
            known += [c * nx - s * ny, s * nx + c * ny]  # x and y in the picture's axes
        told = torch.cat(known, dim=1).permute(0, 2, 3, 1).to(mean.dtype)
        x = torch.cat([pooled.maximum, mean, told], dim=-1)  # (b, h, w, features)
        heeded: Tensor | float = 0.0
        if pooled.weighted is not None and pooled.weights is not None:
            groups = pooled.weighted.unflatten(-1, (pooled.weights.shape[-1], -1))  # (b, h, w, g, f / g)
            means = groups / pooled.weights[..., None]
            heeded = self.heed(means.flatten(-2).to(mean.dtype))
        return self.fuse.together(x, heeded)

    def look(self, digested: Float[Tensor, "b h w c"], n: int, shared: Any) -> Float[Tensor, "b d h w"]:
        (c, s), (nx, nz), ny = shared.azimuth, shared.slant, shared.y
        frame = torch.cat([nx, ny, nz], dim=1)  # (b, 3, h, w)
        x = self.level(digested.permute(0, 3, 1, 2))  # channels last in memory
        x = self.spatial(x)
        if self.coarse is not None:
            x = self.coarse(x)
        if self.finish is not None:
            x = self.finish(x)
        x = self.level(x)
        correction = self.correction(x).float()
        n_x, n_y, n_z = (frame + correction).split(1, dim=1)
        N = F.normalize(torch.cat([c * n_x - s * n_y, s * n_x + c * n_y, n_z], dim=1), dim=1)
        if self.config.compass:
            N = F.normalize(N + self.polish(torch.cat([x, N.to(x.dtype)], dim=1)).float(), dim=1)
        if self.config.memory:
            N = torch.cat([N, self.remember(x).float()], dim=1)
        if not self.config.expected:
            return N
        few = torch.full_like(n_z, n).log()
        seen = torch.cat([x, correction.to(x.dtype), few.to(x.dtype)], dim=1).detach()  # doubt changes no normal
        return torch.cat([N, (LEAST_DEG + self.doubt(seen).float().exp()).clamp(max=90)], dim=1)


def starting_at(std: float, layer: M) -> M:
    """A layer whose weights start with that deviation: 0 where trained weights shall stay what they are."""
    layer.starts_at = std  # pyright: ignore[reportArgumentType]
    return layer


def begun(net: nn.Module) -> Iterator[tuple[nn.Parameter, float]]:
    """The weights that start in a way of their own, and their deviation there."""
    for module in net.modules():
        std = getattr(module, "starts_at", None)
        if std is not None:
            yield module.weight, std  # type: ignore[misc]


class Encoder(nn.Sequential):
    """Each image of a pixel by itself; what an earlier pass tells joins it in the first layer."""

    def __init__(self, hidden: int, features: int) -> None:
        act = nn.LeakyReLU(SLOPE, inplace=True)
        super().__init__(
            nn.Linear(TOKENS, hidden), act, nn.Linear(hidden, hidden), act, nn.Linear(hidden, features), act
        )

    def read(
        self, seen: Float[Tensor, "b k h w t"], recalled: Float[Tensor, "b h w hidden"] | None
    ) -> Float[Tensor, "bkhw features"]:
        first, *others = self
        x = first(seen.flatten(0, 3))  # in two axes: views would make every in-place layer copy
        if recalled is not None:
            x = (x.unflatten(0, seen.shape[:4]) + recalled[:, None].to(x.dtype)).flatten(0, -2)
        for layer in others:
            x = layer(x)
        return x


class Fuse(nn.Sequential):
    """What all images of a pixel showed, and what was heeded of it."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__(nn.Linear(inputs, width), nn.LeakyReLU(SLOPE, inplace=True))

    def together(self, x: Float[Tensor, "b h w c"], heeded: Tensor | float) -> Float[Tensor, "b h w d"]:
        linear, act = self
        return act(linear(x) + heeded)


class Level(nn.Module):
    """Each pixel's features over their root mean square: layers learn at high rates whatever came before them."""

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        return F.rms_norm(x.permute(0, 2, 3, 1), (x.shape[1],)).permute(0, 3, 1, 2)


class Refine(nn.Module):
    """Adds what two layers find."""

    reach = 2

    def __init__(self, width: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        self.first = conv(width, width)
        self.second = starting_at(0.0, nn.Conv2d(width, width, 3, padding=1))

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        return x + self.second(self.first(self.level(x)))


class Far(nn.Module):
    """Adds what is seen at half of the resolution of `x`."""

    def __init__(self, width: int, blocks: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        self.layers = nn.Sequential(Block(width, FAR, 2), *[Block(FAR, FAR) for _ in range(blocks)])
        self.last = starting_at(0.0, nn.Conv2d(FAR, width, 1, bias=False))
        self.reach = 5 + 4 * blocks  # pixels of `x`

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        y = self.level(self.layers(self.level(x)))
        return x + F.interpolate(self.last(y), scale_factor=2, mode="bilinear")


class Coarse(nn.Module):
    """Adds what is seen at a quarter of the resolution, and with `far` blocks at an eighth."""

    def __init__(self, width: int, layers: int, far: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        strides = [2, 2] + [1] * layers
        self.layers = nn.Sequential(*[conv(width, width, s) for s in strides])
        self.far = Far(width, far, level) if far else nn.Identity()
        self.join = Refine(width, level) if far else nn.Identity()
        self.last = starting_at(0.0, nn.Conv2d(width, width, 1, bias=False))
        self.stride = 8 if far else 4
        through = sum(
            getattr(part, "reach", 0) for part in (self.far, self.join)
        )  # pixels of a quarter of the resolution
        self.reach = 9 + 4 * layers + 4 * through

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        y = self.last(self.level(self.join(self.far(self.layers(self.level(x))))))
        return x + F.interpolate(y, scale_factor=4, mode="bilinear")


def cosines(lights: Float[Tensor, "b k 3 *hw"], shared: Shared) -> tuple[tuple[Tensor, Tensor, Tensor], Tensor]:
    """Each pixel's turned lights, x, y, z of (b, k, h, w), and their cosines with the prior (b, k, h, w)."""
    (c, s), (nx, nz), ny = shared.azimuth, shared.slant, shared.y
    x, y, z = at_pixels(lights).float().unbind(2)  # (b, k, 1 or h, 1 or w)
    x, y = c * x + s * y, c * y - s * x  # (b, k, h, w)
    return (x, y, z), nx * x + ny * y + nz * z


def tokens(
    I: Float[Tensor, "b k h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Shared
) -> Float[Tensor, "b k h w 16"]:
    """What is known of an image at a pixel, in the pixel's frame.

    The observation (over the pixel's root mean square) and what it exceeds the prior's shading by, both also as
    logarithms; the turned light and half vector; their cosines with the prior, the latter also magnified near a
    highlight; whether the prior sees the light; the prior itself. (Matrices of 16 columns are several times faster
    than of 8.)
    """
    (x, y, z), cos = cosines(lights, shared)
    nx, nz = (v.expand_as(x) for v in shared.slant)
    s = torch.rsqrt(2 + 2 * z)  # 1 / |l + v|
    half = (cos + nz) * s  # n.h
    shading = cos.clamp(min=0) / shared.shading
    log = torch.log1p(20 * I) / 2 - 1
    excess = log - (torch.log1p(20 * shading) / 2 - 1)
    z, s = z.expand_as(x), s.expand_as(x)
    near, sees = 10 * (half - 0.9).clamp(min=-0.1), (cos > 0).to(cos.dtype)
    h = [x * s, y * s, (z + 1) * s]
    found = [I, I - shading, log, excess, x, y, z, *h, cos, half, near, sees, nx, nz]
    return torch.stack(found, dim=-1)


@dataclass(frozen=True)
class NormalNetMethod(Learned):
    """normalnet: a classical prior as the frame of a per-pixel network that then looks around.

    Parameters
    ----------
    weights, rotations : see Learned
    prior : a classical method in place of the one that the weights were learned with; "": that one
    passes : how often the network looks; from the second time on its own normals are the prior
    """

    prior: str = ""
    passes: Effort = 2
    name = "normalnet"

    def network(self) -> Network:
        return load(self.file, self.name)
