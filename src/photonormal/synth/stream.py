"""An endless, seeded, resumable stream of training batches rendered on the device that trains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.synth.library import data_folder, library
from photonormal.synth.materials import at_points
from photonormal.synth.params import rng, take, to_device
from photonormal.synth.recipes import Recipe, recipe
from photonormal.synth.scene import draw_scenes, look, render, windows
from photonormal.synth.sensor import corrupt, expose, photograph, turned
from photonormal.types import InputError

GROUP, GROUPS = 16, 8  # scenes drawn together; how often in vain before giving up
ELEMENTS = {"cpu": 2**18, "cuda": 2**27}  # samples (pixel, light) rendered at a time
PURPOSES = {"block": 0, "group": 1, "batch": 2}  # so that random numbers of different kinds never meet


@dataclass(frozen=True)
class Batch:
    """`b` samples of `n` images: linear radiance over light intensity, zero outside the mask."""

    images: Float[Tensor, "b n 3 h w"]
    lights: Float[Tensor, "b n 3"]
    normals: Float[Tensor, "b 3 h w"]
    mask: Bool[Tensor, "b 1 h w"]


class Stream:
    """Iterates over `Batch` for ever.

    A block of `recipe.scenes` scenes is rendered at a time; its windows, `recipe.crops` from each, are shuffled and
    dealt into batches. All batches of a block have the same number of lights. Block k depends on nothing but the
    recipe, the seed and k: a stream that starts at step s yields what another yields after s steps, and no sample
    ever comes twice.

    Parameters
    ----------
    name : recipe or its name; further keywords change its fields
    batch : samples in a batch; divides recipe.scenes * recipe.crops, or the rest of a block is dropped
    device : where samples are rendered and stay
    seed, start_step : as above
    """

    def __init__(
        self,
        name: str | Recipe = "train",
        batch: int = 32,
        device: torch.device | str = "cpu",
        seed: int = 0,
        start_step: int = 0,
        **changes: Any,
    ) -> None:
        self.recipe = recipe(name, **changes)
        self.device, self.seed, self.step, self.batch = torch.device(device), seed, start_step, batch
        self.batches = max(1, self.recipe.scenes * self.recipe.crops // batch)  # of a block

    def __iter__(self) -> Iterator[Batch]:
        while True:
            k, first = divmod(self.step, self.batches)
            block = render_block(self.recipe, self.seed, k, self.device, self.batches * self.batch)
            order = torch.from_numpy(rng(self.seed, PURPOSES["batch"], k).permutation(len(block.mask)))
            order = order.to(self.device)
            for i in range(first, self.batches):
                self.step += 1
                yield take(block, order[i * self.batch : (i + 1) * self.batch])


def render_block(recipe: Recipe, seed: int, k: int, device: torch.device, samples: int) -> Batch:
    """`samples` windows of the `k`-th block of scenes."""
    n = lights_of(recipe, seed, k)
    parts: list[Batch] = []
    count = group = 0
    while count < samples:
        for part in render_group(recipe, seed, k, group, n, device):
            parts.append(part)
            count += len(part.mask)
            if count >= samples:
                break
        group += 1
        if group > GROUPS and not parts:
            raise InputError(
                f"{GROUP * group} scenes came without a window of {recipe.crop} pixels that is {recipe.coverage:.0%} "
                "covered; lower coverage or crop."
            )
    return Batch(
        *(torch.cat([getattr(p, f) for p in parts])[:samples] for f in ("images", "lights", "normals", "mask"))
    )


def lights_of(recipe: Recipe, seed: int, k: int) -> int:
    """Number of lights of a block."""
    low, high = recipe.lights
    u = rng(seed, PURPOSES["block"], k).random()
    return min(high, int(np.floor(low * ((high + 1) / low) ** u)))


def render_group(recipe: Recipe, seed: int, k: int, group: int, n: int, device: torch.device) -> Iterator[Batch]:
    """The windows of some scenes, a few scenes at a time; scenes without enough of an object are left out."""
    g = rng(seed, PURPOSES["group"], k, group)
    folder = data_folder(recipe.data)
    shelf = library(folder, recipe.split)
    scenes = draw_scenes(recipe, g, GROUP, n, shelf)
    c, w, s = recipe.crops, recipe.crop, recipe.size
    per = max(1, ELEMENTS.get(device.type, 2**27) // (n * c * w * w))
    offsets = (torch.arange(w)[:, None] * s + torch.arange(w)).flatten().to(device)
    for first in range(0, GROUP, per):
        some = to_device(take(scenes, slice(first, first + per)), device)
        noise_seed = int(g.integers(2**62))
        generator = torch.Generator(device).manual_seed(noise_seed)
        geometry = look(some, s)
        corner, enough = windows(geometry, recipe, torch.Generator().manual_seed(noise_seed))
        if not bool(enough.any()):
            continue
        if not bool(enough.all()):
            some, geometry, corner = take(some, enough), take(geometry, enough), corner[enough]
        b = len(corner)
        pixels = (corner[..., None] + offsets).flatten(1)  # (b, k w w)
        I = render(some, geometry, pixels, recipe, shelf, noise_seed)  # (b, n, 3, k w w)
        I = I.view(b, n, 3, c, w, w).movedim(3, 1).flatten(0, 1)  # (b k, n, 3, w, w)
        N = at_points(geometry.normals, pixels).view(b, 3, c, w, w).transpose(1, 2).flatten(0, 1)
        mask = at_points(geometry.mask[:, None], pixels).view(b, 1, c, w, w).transpose(1, 2).flatten(0, 1)
        L = some.lights
        yield _measured(recipe, I, L, N, mask, c, g, generator)


def _measured(recipe: Recipe, I: Tensor, L: Tensor, N: Tensor, mask: Tensor, c: int, g: np.random.Generator, generator):
    """What a camera and imperfectly known lights make of the windows (c of each scene)."""
    b, n, _ = L.shape
    device = I.device

    def drawn(values: np.ndarray) -> Tensor:
        return torch.from_numpy(values.astype(np.float32)).to(device).repeat_interleave(c)

    I = expose(I, mask[:, 0], c, torch.from_numpy(recipe.saturated * g.random(b) ** 2).float().to(device))
    error = recipe.intensity_error * g.random((b, 1)) * g.normal(size=(b, n))
    if recipe.intensity_error:
        I = I * torch.from_numpy(1 + error).float().to(device).repeat_interleave(c, 0)[:, :, None, None, None]
    bits = np.where(g.random(b) < recipe.low_bits, 8.0, 16.0) * (recipe.low_bits > 0)
    I = photograph(I, drawn(recipe.noise * g.random(b) ** 2), drawn(bits), generator)
    share = np.where(g.random(b) < recipe.corrupted, g.uniform(0.05, 0.2, b), 0.0)
    I = corrupt(I, drawn(share), g)
    I = I * mask[:, None]
    known = turned(L.cpu().numpy().astype(np.float64), g, recipe.light_error_deg * g.random(b))
    known = torch.from_numpy(known).float().to(device).repeat_interleave(c, 0)
    return Batch(I, known, N, mask)
