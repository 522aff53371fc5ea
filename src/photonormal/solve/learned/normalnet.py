"""A classical prior as the frame of a network: a pixel reads its own images first, then looks around (normalnet).

Fed as plain features a prior is copied, its bias included; as a frame it isn't. Each pixel's lights are turned about
the view axis until the prior's azimuth is zero, so that one isotropic material looks the same from every side and a
whole degree of freedom need not be learned. A shared encoder reads each image of a pixel; mean and maximum over the
images, and means that weigh each image by what is seen in it; 3 x 3 layers at full resolution; a correction is added
to the prior. Untrained it returns its prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.options import Effort
from photonormal.solve.learned.layers import SLOPE, Block, conv
from photonormal.solve.learned.method import Learned
from photonormal.solve.learned.network import Network, at_pixels
from photonormal.solve.learned.pooling import Pooled, pool, weighted_sum
from photonormal.solve.learned.weights import load
from photonormal.types import InputError

TOKENS = 16  # numbers per image and pixel, see `tokens`
ADDED = (  # start at zero: trained weights stay what they are
    *("coarse.last.weight", "coarse.far.last.weight", "coarse.join.second.weight", "finish.second.weight"),
    *("recall.weight", "heed.weight"),
)
TOLD = ("correction.weight", "polish.2.weight")  # start near zero: what the network returns is its prior
FAR = 192  # channels at an eighth of the resolution
WEIGHT = 4.0  # logarithm of the largest weight of an image in a weighted mean; the least is its inverse
POLISH = 64  # channels of the layers that correct the normals in the picture's axes
DOUBT = 32  # channels of the layer that tells the expected error
LEAST_DEG = 0.3  # expected error; a true one over an expected one of nearly nothing would swamp all other gradients


@dataclass(frozen=True)
class NormalNetConfig:
    """The network's switches; the defaults have 0.345 million parameters, the weights that ship 3.649.

    Parameters
    ----------
    prior : the classical method that gives the frame
    turn : turn each pixel until the prior's azimuth is zero
    tilt : tilt it, too, until the prior points to the viewer: the full local frame; only with `turn`
    hidden, features : channels of the encoder's first two layers, and of its last
    width, layers : channels and number of the 3 x 3 layers before the last one
    blocks : residual blocks of two such layers, in place of `layers`, where not 0
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

    prior: str = "trimmed"
    turn: bool = True
    tilt: bool = False
    hidden: int = 64
    features: int = 128
    width: int = 128
    layers: int = 2
    blocks: int = 0
    expected: bool = False
    memory: int = 0
    coarse: int = 0
    far: int = 0
    attention: int = 0
    level: bool = False
    compass: bool = False


class Shared(NamedTuple):
    """What all images of a pixel share."""

    azimuth: tuple[Tensor, Tensor]  # cosine and sine (b, 1, h, w) of the angle that is turned away
    slant: tuple[Tensor, Tensor]  # x and z (b, 1, h, w) of the turned prior
    y: Tensor  # (b, 1, h, w), zero where turned
    shading: Tensor  # (b, 1, h, w) root mean square of max(n.l, 0) of the prior over all lights
    recalled: Tensor | None = None  # (b, h, w, hidden) what an earlier pass tells the encoder
    tilted: bool = False  # whether a pixel's z is its prior instead of the view axis

    def rows(self, some: slice) -> Shared:
        """The same of some rows of pixels."""
        c, s, nx, nz, y, shading = (v[:, :, some] for v in (*self.azimuth, *self.slant, self.y, self.shading))
        recalled = None if self.recalled is None else self.recalled[:, some]
        return Shared((c, s), (nx, nz), y, shading, recalled, self.tilted)


class NormalNet(Network):
    """Grey images (b, n, 1, h, w) over their root mean square, lights (b, n, 3), prior (b, 3, h, w) to unit normals."""

    Config: ClassVar[type] = NormalNetConfig
    scaling = "grey"
    stride = 1
    pointwise = True

    def __init__(self, config: NormalNetConfig = NormalNetConfig()) -> None:
        super().__init__()
        self.config = c = config
        if c.tilt and not c.turn:
            raise InputError("tilt=True came with turn=False but a pixel is tilted after it is turned; set turn=True.")
        if c.far and not c.coarse:
            raise InputError(f"far={c.far} came with coarse=0 but what is far is seen through it; set coarse.")
        self.reach = (2 * c.blocks or c.layers) + 1 + max(c.expected, 3 * c.compass) + 2 * (c.far > 0)
        if c.coarse:
            self.stride = 8 if c.far else 4
            self.reach += 9 + 4 * c.coarse + (28 + 16 * c.far if c.far else 0)
            self.reach = -(-self.reach // self.stride) * self.stride
        self.memory = c.memory
        weighted = c.features + c.attention if c.attention else 0
        self.floats = 2 * c.features + weighted + 8 + c.memory + c.hidden * (c.memory > 0)
        act = nn.LeakyReLU(SLOPE, inplace=True)
        self.encoder = nn.Sequential(
            nn.Linear(TOKENS, c.hidden), act, nn.Linear(c.hidden, c.hidden), act, nn.Linear(c.hidden, c.features), act
        )
        self.fuse = nn.Sequential(nn.Linear(2 * c.features + 3 + 2 * c.compass, c.width), act)
        if c.attention:
            self.score = nn.Linear(c.features, c.attention)
            self.heed = nn.Linear(c.features, c.width, bias=False)
        self.level = Level() if c.level else nn.Identity()
        layer, count = (Block, c.blocks) if c.blocks else (conv, c.layers)
        self.spatial = nn.Sequential(*[layer(c.width, c.width) for _ in range(count)])
        self.correction = nn.Conv2d(c.width, 3, 3, padding=1)
        if c.coarse:
            self.coarse = Coarse(c.width, c.coarse, c.far, self.level)
        if c.far:
            self.finish = Refine(c.width, self.level)
        if c.compass:
            self.polish = nn.Sequential(
                conv(c.width + 3, POLISH), conv(POLISH, POLISH), nn.Conv2d(POLISH, 3, 3, padding=1)
            )
        if c.memory:
            self.remember = nn.Conv2d(c.width, c.memory, 1)
            self.recall = nn.Linear(c.memory, c.hidden, bias=False)
        if c.expected:
            self.doubt = nn.Sequential(conv(c.width + 4, DOUBT), nn.Conv2d(DOUBT, 1, 3, padding=1))
        for module in self.modules():
            if isinstance(module, nn.Linear | nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, a=SLOPE)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
            if isinstance(module, Block):  # a branch starts small beside its shortcut
                module.second.weight.data.mul_(0.3)
        for key, p in self.named_parameters():
            if key in ADDED:
                nn.init.zeros_(p)
            if key in TOLD:
                nn.init.normal_(p, std=1e-3)

    def begin(self, prior: Float[Tensor, "b c h w"], lights: Float[Tensor, "b n 3 *hw"]) -> Shared:
        prior, memory = prior[:, :3], prior[:, 3:]
        recalled = self.recall(memory.permute(0, 2, 3, 1)) if memory.shape[1] else None
        known = prior.square().sum(1, keepdim=True) > 0.25
        x, y, z = torch.where(known, prior, prior.new_tensor([0.0, 0.0, 1.0])[:, None, None]).float().split(1, dim=1)
        z = z.clamp(min=0.05)  # a surface that is seen looks towards the camera
        r = torch.sqrt(x * x + y * y)
        c, s = torch.where(r > 1e-6, x / r, 1.0), torch.where(r > 1e-6, y / r, 0.0)
        if not self.config.turn:
            c, s = torch.ones_like(c), torch.zeros_like(s)
        x, y = c * x + s * y, c * y - s * x
        length = torch.sqrt(x * x + y * y + z * z)
        shared = Shared((c, s), (x / length, z / length), y / length, torch.ones_like(c), recalled, self.config.tilt)
        total = torch.zeros_like(c)
        for light in lights.split(32, dim=1):
            total += cosines(light, shared)[1].clamp(min=0).square().sum(1, keepdim=True)
        return shared._replace(shading=(total / lights.shape[1]).sqrt().clamp(min=0.05))

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        seen = tokens(images[:, :, 0], lights, shared)  # (b, k, h, w, 16)
        x = self.encoder[0](seen.flatten(0, 3))  # in two axes: views would make every in-place layer copy
        if shared.recalled is not None:
            x = x.unflatten(0, seen.shape[:4]) + shared.recalled[:, None].to(x.dtype)
        features = self.encoder[2:](self.encoder[1](x).flatten(0, -2))
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
        x = self.fuse[0](x)
        if pooled.weighted is not None and pooled.weights is not None:
            groups = pooled.weighted.unflatten(-1, (pooled.weights.shape[-1], -1))  # (b, h, w, g, f / g)
            means = groups / pooled.weights[..., None]
            x = x + self.heed(means.flatten(-2).to(mean.dtype))
        return self.fuse[1](x)

    def look(self, digested: Float[Tensor, "b h w c"], n: int, shared: Any) -> Float[Tensor, "b d h w"]:
        (c, s), (nx, nz), ny = shared.azimuth, shared.slant, shared.y
        frame = torch.cat([nx, ny, nz], dim=1)  # (b, 3, h, w)
        x = self.level(digested.permute(0, 3, 1, 2))  # channels last in memory
        x = self.spatial(x)
        if self.config.coarse:
            x = self.coarse(x)
        if self.config.far:
            x = self.finish(x)
        x = self.level(x)
        correction = self.correction(x).float()
        if shared.tilted:
            n_x, n_y, n_z = correction.split(1, dim=1)
            n_x, n_z = nz * n_x + nx * (1 + n_z), nz * (1 + n_z) - nx * n_x
        else:
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


class Level(nn.Module):
    """Each pixel's features over their root mean square: layers learn at high rates whatever came before them."""

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        return F.rms_norm(x.permute(0, 2, 3, 1), (x.shape[1],)).permute(0, 3, 1, 2)


class Refine(nn.Module):
    """Adds what two layers find."""

    def __init__(self, width: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        self.first = conv(width, width)
        self.second = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        return x + self.second(self.first(self.level(x)))


class Far(nn.Module):
    """Adds what is seen at half of the resolution of `x`."""

    def __init__(self, width: int, blocks: int, level: nn.Module) -> None:
        super().__init__()
        self.level = level
        self.layers = nn.Sequential(Block(width, FAR, 2), *[Block(FAR, FAR) for _ in range(blocks)])
        self.last = nn.Conv2d(FAR, width, 1, bias=False)

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
        self.last = nn.Conv2d(width, width, 1, bias=False)

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
    v_x, v_z = (-nx, nz) if shared.tilted else (0.0, 1.0)
    if shared.tilted:
        x, z = nz * x - nx * z, cos
    shading = cos.clamp(min=0) / shared.shading
    log = torch.log1p(20 * I) / 2 - 1
    excess = log - (torch.log1p(20 * shading) / 2 - 1)
    z, s = z.expand_as(x), s.expand_as(x)
    near, sees = 10 * (half - 0.9).clamp(min=-0.1), (cos > 0).to(cos.dtype)
    h = [(x + v_x) * s, y * s, (z + v_z) * s]
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
