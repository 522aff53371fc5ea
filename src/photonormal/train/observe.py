"""From a rendered batch to what a network is shown: some of its images, turned, scaled, with a prior.

Every draw depends on the seed, the step and the process alone, so a resumed training sees what an unbroken one does.
"""

from __future__ import annotations

from functools import cache
from math import pi
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from photonormal.methods.engine.prior import prior_named
from photonormal.methods.inputs.grey import grey
from photonormal.methods.inputs.maps import about_view
from photonormal.methods.inputs.scaling import moment, scaled
from photonormal.methods.learned.lightsnet import LightsNet
from photonormal.methods.learned.weights import load_network, shipped
from photonormal.methods.uncalibrated.guess import looked
from photonormal.train.recipes import Recipe

TILT_DEG = 30.0  # of the prior that is made from the truth


class Observed(NamedTuple):
    """One batch as a network sees it, with the truth."""

    images: Tensor  # (b, k, c, h, w) scaled
    lights: Tensor  # (b, k, 3) as believed, or (b, k, 3, h, w) where pixels are turned one by one
    prior: Tensor  # (b, 3, h, w), zero outside the mask
    normals: Tensor  # (b, 3, h, w)
    mask: Tensor  # (b, 1, h, w)
    intensities: Tensor  # (b, k) of the lights, which the images have in them


def observe(batch: Any, recipe: Recipe, scaling: str, step: int, rank: int = 0, vary: bool = True) -> Observed:
    """What the network is shown of a rendered batch (images, lights, normals, mask).

    `vary` False, for validation: the first `recipe.images[1]` images as they are, the first of the recipe's priors.
    All processes see as many images in a step, with the same prior, so that none waits for another.
    """
    images, lights, normals, mask = batch.images.nan_to_num(), batch.lights, batch.normals, batch.mask
    common = torch.Generator().manual_seed(hash((recipe.seed, step)) % 2**62)
    draw = torch.Generator().manual_seed(hash((recipe.seed, step, rank)) % 2**62)
    n = images.shape[1]
    name = drawn_prior(recipe, common, vary)
    if vary:
        low, high = (torch.tensor(float(min(k, n))).log() for k in recipe.images)
        k = int((low + (high - low) * torch.rand((), generator=common)).exp().round())
        kept = torch.randperm(n, generator=draw)[:k].to(images.device)
        if recipe.pixels:
            images, normals, mask = some_pixels(recipe.pixels, images, normals, mask, draw)
        images, lights = images[:, kept], lights[:, kept]
        if recipe.turns and recipe.pixels:
            lights, normals = turn_each(lights, normals, draw)
        elif recipe.turns:
            images, lights, normals, mask = turn(
                images, lights, normals, mask, int(torch.randint(8, (), generator=draw))
            )
    else:
        images, lights = images[:, : recipe.images[1]], lights[:, : recipe.images[1]]
    e = drawn_intensities(recipe, lights.shape[:2], draw).to(images)
    images = images * e[..., None, None, None]
    if recipe.lights:
        images, lights = under_told(teller_of_lights(recipe.lights, images.device), images, mask)
    prior = prior_normals(name, images, lights, normals, mask, draw)
    if vary and recipe.dark:
        images = images * (torch.rand(images.shape, generator=draw) >= recipe.dark).to(images)
    moments = moment(scaling, images, mask)
    x = scaled(scaling, images, mask, moments, images.shape[1])
    if vary and scaling == "exposure":
        low, high = (torch.tensor(float(g)).log() for g in recipe.gain)
        x = x * (low + (high - low) * torch.rand(len(x), 1, 1, 1, 1, generator=draw)).exp().to(x)
    return Observed(x, lights, prior, normals * mask, mask, e)


def some_pixels(
    count: int, images: Tensor, normals: Tensor, mask: Tensor, draw: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Pixels on the mask of each sample, by chance, as pictures of one row."""
    drawn = torch.multinomial(mask.flatten(1).float().cpu(), count, replacement=True, generator=draw).to(mask.device)

    def taken(x: Tensor) -> Tensor:
        at = drawn.view(len(drawn), *[1] * (x.ndim - 3), count)
        return x.flatten(-2).take_along_dim(at, -1)[..., None, :]  # (b, ..., 1, q)

    return taken(images), taken(normals), taken(mask)


def turn_each(lights: Tensor, normals: Tensor, draw: torch.Generator) -> tuple[Tensor, Tensor]:
    """The lights (b, k, 3, 1, q) and the normal of each pixel after a turn about the view of its own, or mirrored, too.

    An isotropic surface shows the same samples then.
    """
    b, _, _, q = normals.shape
    angle = (2 * pi * torch.rand(b, 1, q, generator=draw)).to(normals)
    side = (torch.randint(2, (b, 1, q), generator=draw) * 2.0 - 1).to(normals)  # of x
    flip = torch.stack([side, torch.ones_like(side), torch.ones_like(side)], dim=-1)  # (b, 1, q, 3)
    L = about_view(lights[:, :, None] * flip, angle)  # (b, k, q, 3)
    N = about_view(normals.permute(0, 2, 3, 1) * flip, angle)  # (b, 1, q, 3)
    return L.transpose(2, 3)[..., None, :], N.permute(0, 3, 1, 2)


def drawn_prior(recipe: Recipe, draw: torch.Generator, vary: bool) -> str:
    """One of the recipe's priors; "" where it has none."""
    if not recipe.priors:
        return ""
    shares = torch.tensor([share for _, share in recipe.priors])
    return recipe.priors[int(torch.multinomial(shares, 1, generator=draw)) if vary else 0][0]


def drawn_intensities(recipe: Recipe, shape: torch.Size, draw: torch.Generator) -> Tensor:
    """Intensities (b, k): within the recipe's factors, each sample's spread over a share of that range; else all 1."""
    low, high = (torch.tensor(float(e)).log() for e in recipe.intensities)
    if low == high:
        return torch.ones(shape)
    return ((low + (high - low) * torch.rand(shape, generator=draw)) * torch.rand(shape[0], 1, generator=draw)).exp()


@cache
def teller_of_lights(name: str, device: torch.device) -> LightsNet:
    """The network that finds lights, of the package's weights."""
    return load_network(shipped(name), "lightsnet", device)


@torch.no_grad()
def under_told(net: LightsNet, images: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Images (b, k, c, h, w) of whole objects over the intensities that a network gives, and directions (b, k, 3)."""
    told = looked(net, images, mask)
    return images / told.log_intensities.exp()[..., None, None, None].to(images), told.directions


def prior_normals(
    name: str, images: Tensor, lights: Tensor, normals: Tensor, mask: Tensor, draw: torch.Generator
) -> Tensor:
    """Normals (b, 3, h, w) of a classical method from these very images, zero outside the mask."""
    if not name:
        return torch.zeros_like(normals)
    if name == "truth":
        N = tilted(normals, draw)
    else:
        I = grey(images)[:, :, 0].flatten(2).mT  # (b, p, k)
        prior = prior_named(name)
        assert prior is not None
        N = prior.normals(I, lights).mT.unflatten(2, mask.shape[2:])
    return N * mask


def tilted(normals: Tensor, draw: torch.Generator) -> Tensor:
    """Normals tilted smoothly over each sample, by up to TILT_DEG: a prior that no method gives, right on average."""
    b, _, h, w = normals.shape
    field = F.interpolate(torch.randn(b, 3, 3, 3, generator=draw), (h, w), mode="bicubic", align_corners=True)
    field = F.normalize(field, dim=1) * torch.deg2rad(TILT_DEG * torch.rand(b, 1, 1, 1, generator=draw)).tan()
    return F.normalize(normals + field.to(normals), dim=1)


def turn(images: Tensor, lights: Tensor, normals: Tensor, mask: Tensor, case: int) -> tuple[Tensor, ...]:
    """One of the eight symmetries of a square, of pictures and vectors alike."""
    if case >= 4:  # x -> -x
        sign = lights.new_tensor([-1.0, 1.0, 1.0])
        images, mask = images.flip(-1), mask.flip(-1)
        lights, normals = lights * sign, normals.flip(-1) * sign[:, None, None]
    r = case % 4
    images, mask, normals = (torch.rot90(x, r, (-2, -1)) for x in (images, mask, normals))
    for _ in range(r):  # counter-clockwise: (x, y) -> (-y, x)
        lights = torch.stack([-lights[..., 1], lights[..., 0], lights[..., 2]], dim=-1)
        normals = torch.stack([-normals[:, 1], normals[:, 0], normals[:, 2]], dim=1)
    return images, lights, normals, mask
