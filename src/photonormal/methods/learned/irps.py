"""Neural inverse rendering: T. Taniai, T. Maehara, ICML 2018. No weights: it learns on the object that it measures."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.masked import box_of
from photonormal.methods.classical.woodham import Woodham
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.learned.layers import unit
from photonormal.methods.learned.processor import inner_precision
from photonormal.options import Count, Effort, Seed
from photonormal.progress import progress
from photonormal.shading import normalised

MARGIN = 5  # pixels around the object
SHOWN = 0.1  # share of the samples that a loss is taken over
EARLY, PULL = 50, 0.1  # iterations in which least squares pull the normals, and how much
LAST = 0.1  # share of the iterations, at the end, with a tenth of the rate and fixed statistics
RATE = 8e-4
RENDERED = 16  # channels of the rendering network


@dataclass(frozen=True)
class IRPS:
    """Two networks learn one object: one finds normals from all images, one renders each image back from the normals.

    The loss is mean |rendering - image|; in the first iterations least-squares normals pull, too. Nothing but the
    object's own photographs is learned from. Where the object has more than `pixels` it learns from reduced images;
    what it changes in least-squares normals is then carried over to all pixels. Needs 4 lights.

    Parameters
    ----------
    iterations : steps of learning
    width : channels of the network of normals (384 in the paper)
    images : how many of the images are rendered in an iteration (all in the paper)
    pixels : of the object's box, up to which images are taken as they are
    seed : of the first weights, and of what is drawn
    """

    iterations: Effort = 1000
    width: Count = 128
    images: Count = 16
    pixels: Count = 16_000
    seed: Seed = 0

    needs: ClassVar[Needs] = Needs(images=4, reads="object", optimises=True)

    def __call__(self, seen: Observations) -> Solution:
        assert seen.mask is not None and seen.pictures is not None
        rows, columns = box_of(seen.mask.numpy(), MARGIN)
        whole = seen.mask[rows, columns].to(seen.lights.device)
        by = max(1, ceil(sqrt(whole.numel() / self.pixels)))
        prior = Woodham().normals(seen.I.to(seen.lights), seen.lights)

        def small(x: Float[Tensor, "n c h w"]) -> Float[Tensor, "n c i j"]:
            return reduced(x, whole, by)

        N = torch.zeros(1, 3, *whole.shape).to(prior)  # least squares, on the map
        N[0, :, whole] = prior.T
        L = torch.zeros(*whole.shape, *seen.lights.shape[-2:]).to(prior)
        L[whole] = seen.lights
        I = small(seen.pictures()[..., rows, columns])
        scene = Scene(I, unit(small(L.permute(2, 3, 0, 1))), unit(small(N)), reduced_mask(whole, by))
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            found = self.learned(scene)
        if by == 1:
            return Solution(found[0][:, whole].T)
        change = F.interpolate(found - scene.prior, scale_factor=by, mode="bilinear")[
            0, :, : len(whole), : len(whole.T)
        ]
        return Solution(normalised((N[0] + change)[:, whole].T))

    def learned(self, scene: Scene) -> Float[Tensor, "1 3 h w"]:
        """The normals after all iterations."""
        n, c = scene.I.shape[:2]
        normals, rendering = PSNet(n * c + 1, self.width), RenderingNet(c, self.width)
        parameters = [*normals.parameters(), *rendering.parameters()]
        descent = torch.optim.Adam(parameters, lr=RATE)
        mask = scene.mask[None, None].float()
        I = scene.I * mask
        I = I / (2 * (I.square().sum() / mask.sum() / n / c).sqrt()).clamp(min=1e-9)
        seen = torch.cat([I.flatten(0, 1)[None], mask], dim=1)
        last = int(self.iterations * (1 - LAST))
        with torch.enable_grad(), progress("learning", self.iterations) as advance:
            for step in range(self.iterations):
                if step == last:
                    descent.param_groups[0]["lr"] = RATE / 10
                    for net in (normals, rendering):
                        net.apply(fix)
                some = torch.randperm(n)[: self.images]
                with inner_precision(I.device):
                    N, features = normals(seen, mask)
                    cos = (N * scene.L[some]).sum(1, keepdim=True)
                    mirrored = 2 * N[:, 2:] * cos - scene.L[some, 2:]  # z of the light mirrored by the surface
                    found = rendering(torch.cat([I[some], mirrored], dim=1), features, mask) * cos.clamp(min=0)
                shown = mask * (torch.rand(len(some), 1, *mask.shape[2:]) < SHOWN)
                loss = ((found - I[some]).abs() * shown).sum() / shown.sum().clamp(min=1) / c
                if step < EARLY:
                    loss = loss + PULL * I.mean() * ((N - scene.prior).square() * mask).sum() / mask.sum()
                descent.zero_grad()
                loss.backward()
                descent.step()
                advance(1)
            with inner_precision(I.device):
                return normals(seen, mask)[0].detach()


@dataclass(frozen=True)
class Scene:
    """What is learned from: linear images, the lights of each pixel, least-squares normals, the mask."""

    I: Float[Tensor, "n c h w"]
    L: Float[Tensor, "n 3 h w"]
    prior: Float[Tensor, "1 3 h w"]
    mask: Bool[Tensor, "h w"]


class Normed(nn.Module):
    """Batch normalisation by the statistics of the mask's pixels, of the batch at hand or fixed; then ReLU."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.gain, self.offset = nn.Parameter(torch.ones(channels, 1, 1)), nn.Parameter(torch.zeros(channels, 1, 1))
        self.mean, self.scale = torch.zeros(channels, 1, 1), torch.ones(channels, 1, 1)
        self.fixed = False

    def forward(self, x: Float[Tensor, "b c h w"], mask: Float[Tensor, "1 1 h w"]) -> Float[Tensor, "b c h w"]:
        mean, scale = self.mean, self.scale
        if not self.fixed:
            count = mask.sum() * len(x)
            masked = (x * mask).float()
            mean = masked.sum((0, 2, 3), keepdim=True)[0] / count
            variance = masked.square().sum((0, 2, 3), keepdim=True)[0] / count - mean**2
            scale = (variance.clamp(min=0) + 1e-5).rsqrt()
            self.mean, self.scale = mean.detach(), scale.detach()
        gain = self.gain * scale
        return F.relu(torch.addcmul(self.offset - mean * gain, x, gain.to(x.dtype)).to(x.dtype))


def fix(module: nn.Module) -> None:
    """Keep the statistics that a normalisation has."""
    if isinstance(module, Normed):
        module.fixed = True


class Layer(nn.Module):
    """3 x 3 convolution, normalisation, ReLU."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv, self.norm = nn.Conv2d(inputs, outputs, 3, padding=1), Normed(outputs)

    def forward(self, x: Float[Tensor, "b c h w"], mask: Float[Tensor, "1 1 h w"]) -> Float[Tensor, "b d h w"]:
        return self.norm(self.conv(x), mask)


class PSNet(nn.Module):
    """Unit normals and features from all images and the mask."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(Layer(inputs if k == 0 else width, width) for k in range(4))
        self.last = nn.Conv2d(width, 3, 3, padding=1)

    def forward(self, x: Float[Tensor, "1 c h w"], mask: Float[Tensor, "1 1 h w"]) -> tuple[Tensor, Tensor]:
        for layer in self.layers:
            x = layer(x, mask)
        return unit(self.last(x)), x


class RenderingNet(nn.Module):
    """Each image over n.l, from itself, the mirrored light and the features that all images share."""

    def __init__(self, channels: int, width: int) -> None:
        super().__init__()
        self.first = nn.ModuleList(Layer(channels + 1 if k == 0 else RENDERED, RENDERED) for k in range(4))
        self.image = nn.Conv2d(RENDERED, RENDERED, 3, padding=1, bias=False)
        self.shared = nn.Conv2d(width, RENDERED, 3, padding=1)
        self.joined = Normed(RENDERED)
        self.second = Layer(RENDERED, RENDERED)
        self.last = nn.Conv2d(RENDERED, channels, 3, padding=1)

    def forward(
        self, x: Float[Tensor, "k c h w"], features: Float[Tensor, "1 f h w"], mask: Float[Tensor, "1 1 h w"]
    ) -> Float[Tensor, "k d h w"]:
        for layer in self.first:
            x = layer(x, mask)
        x = self.joined(self.image(x) + self.shared(features), mask)
        return self.last(self.second(x, mask)).float()


def reduced(x: Float[Tensor, "n c h w"], mask: Bool[Tensor, "h w"], by: int) -> Float[Tensor, "n c i j"]:
    """Means over the mask's pixels in squares of `by` pixels; zero where a square holds none."""
    return _means(x * mask, by) / _means(mask[None, None].float(), by).clamp(min=1e-9)


def reduced_mask(mask: Bool[Tensor, "h w"], by: int) -> Bool[Tensor, "i j"]:
    """Squares that hold any pixel of the mask."""
    return _means(mask[None, None].float(), by)[0, 0] > 0


def _means(x: Float[Tensor, "n c h w"], by: int) -> Float[Tensor, "n c i j"]:
    h, w = x.shape[2:]
    return F.avg_pool2d(F.pad(x, (0, -w % by, 0, -h % by)), by)
