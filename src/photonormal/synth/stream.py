"""An endless, seeded, resumable stream of training batches rendered on the device that trains."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.synth.library import Library, data_folder, library
from photonormal.synth.materials import at_points
from photonormal.synth.params import rng, take, to_device
from photonormal.synth.recipes import Rendering, parts
from photonormal.synth.scene import ELEMENTS, Scenes, draw_scenes, frame, shaded, windows
from photonormal.synth.sensor import sensed
from photonormal.synth.trace import WindowView, visible_surface
from photonormal.types import InputError

T = TypeVar("T")

GROUP = {"cpu": 8, "cuda": 64}  # scenes drawn and framed together: fits a cache, fills a GPU
PARTS = {"cpu": 4}  # at least so many groups, where there are scenes enough: work for that many cores
GROUPS = 8  # how often in vain before giving up
PURPOSES = {"block": 0, "group": 1, "batch": 2, "mixture": 3}  # so that random numbers of different kinds never meet


@dataclass(frozen=True)
class RenderedBatch:
    """`b` samples of `n` images: linear radiance over light intensity, zero outside the mask."""

    images: Float[Tensor, "b n 3 h w"]
    lights: Float[Tensor, "b n 3"]
    normals: Float[Tensor, "b 3 h w"]
    mask: Bool[Tensor, "b 1 h w"]


class Stream:
    """Iterates over `RenderedBatch` for ever.

    A block of `recipe.scenes` scenes is rendered at a time; its windows, `recipe.crops` from each, are shuffled and
    dealt into batches. All batches of a block have the same number of lights. Block k depends on nothing but the
    recipe, the seed and k: a stream that starts at step s yields what another yields after s steps, and no sample
    ever comes twice.

    Parameters
    ----------
    name : recipe, its name or that of a mixture of some, which blocks take in turn by chance; further keywords change
        fields of them all
    batch : samples in a batch; divides recipe.scenes * recipe.crops, or the rest of a block is dropped
    device : where samples are rendered and stay
    seed, start_step : as above
    """

    def __init__(
        self,
        name: str | Rendering = "train",
        batch: int = 32,
        device: torch.device | str = "cpu",
        seed: int = 0,
        start_step: int = 0,
        **changes: Any,
    ) -> None:
        recipes, self.shares = zip(*parts(name, **changes), strict=True)
        self.recipes: tuple[Rendering, ...] = recipes
        self.device, self.seed, self.step, self.batch = torch.device(device), seed, start_step, batch
        fewest = min(r.scenes * r.crops for r in self.recipes)
        self.batches = max(1, fewest // batch)  # of a block

    def __iter__(self) -> Iterator[RenderedBatch]:
        while True:
            k, first = divmod(self.step, self.batches)
            block = render_block(self.recipe_of(k), self.seed, k, self.device, self.batches * self.batch)
            order = torch.from_numpy(rng(self.seed, PURPOSES["batch"], k).permutation(len(block.mask)))
            order = order.to(self.device)
            for i in range(first, self.batches):
                self.step += 1
                yield take(block, order[i * self.batch : (i + 1) * self.batch])

    def recipe_of(self, k: int) -> Rendering:
        """What block `k` is rendered by."""
        if len(self.recipes) == 1:
            return self.recipes[0]
        return self.recipes[int(rng(self.seed, PURPOSES["mixture"], k).choice(len(self.recipes), p=self.shares))]


def render_block(recipe: Rendering, seed: int, k: int, device: torch.device, samples: int) -> RenderedBatch:
    """`samples` windows of the `k`-th block of scenes."""
    n = number_of_lights(recipe, seed, k)
    parts: list[RenderedBatch] = []
    missing, count = samples, 0  # windows to render, groups so far
    with workers(device) as work:
        while missing > 0:
            scenes = -(-missing // recipe.crops)
            size = min(GROUP.get(device.type, 64), -(-scenes // PARTS.get(device.type, 1)))
            sizes = [min(size, scenes - first) for first in range(0, scenes, size)]
            keys = [(seed, k, count + i) for i in range(len(sizes))]
            tasks = [partial(render_group, recipe, key, b, n, device) for key, b in zip(keys, sizes, strict=True)]
            parts += (new := [part for group in work(tasks) for part in group])
            missing -= sum(len(part.mask) for part in new)
            count += len(tasks)
            if count > GROUPS and missing == samples:
                raise InputError(
                    f"no window of {recipe.crop} pixels in {count} groups of scenes is {recipe.coverage:.0%} covered; "
                    "lower coverage or crop."
                )
    return RenderedBatch(
        *(torch.cat([getattr(p, f) for p in parts])[:samples] for f in ("images", "lights", "normals", "mask"))
    )


def number_of_lights(recipe: Rendering, seed: int, k: int) -> int:
    """Number of lights of a block."""
    if recipe.directions:
        return len(recipe.directions)
    low, high = recipe.lights
    u = rng(seed, PURPOSES["block"], k).random()
    return min(high, int(np.floor(low * ((high + 1) / low) ** u)))


@contextmanager
def workers(device: torch.device) -> Iterator[Callable[[list[Callable[[], T]]], Iterable[T]]]:
    """Runs tasks: on a GPU in turn; on the processor on as many threads as torch uses, each with one core."""
    n = torch.get_num_threads()
    if device.type != "cpu" or n == 1:
        yield lambda tasks: (task() for task in tasks)
        return
    with ThreadPoolExecutor(n, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        try:
            yield lambda tasks: pool.map(lambda task: task(), tasks)
        finally:
            torch.set_num_threads(n)  # a worker's setting reaches MKL, which all threads share


def render_group(
    recipe: Rendering, key: tuple[int, int, int], b: int, n: int, device: torch.device
) -> list[RenderedBatch]:
    """The windows of `b` scenes, a few scenes at a time; scenes without enough of an object are left out."""
    g = rng(key[0], PURPOSES["group"], *key[1:])
    shelf = library(data_folder(recipe.data), recipe.split)
    scenes = to_device(draw_scenes(recipe, g, b, n, shelf), device)
    view, start = frame(scenes, recipe.size)
    per = max(1, ELEMENTS.get(device.type, 2**27) // (n * recipe.crops * recipe.crop**2))
    some = [slice(first, first + per) for first in range(0, b, per)]
    return [render_windows(take(scenes, i), take(view, i), start[i], recipe, shelf, g) for i in some]


def render_windows(
    scenes: Scenes, view: WindowView, start: Tensor, recipe: Rendering, shelf: Library | None, g: np.random.Generator
) -> RenderedBatch:
    """The windows of some scenes, as the camera measures them."""
    device, c, w, s = start.device, recipe.crops, recipe.crop, recipe.size
    seed = int(g.integers(2**62))
    geometry = visible_surface(scenes.solids, view, start)
    corner, enough = windows(geometry, recipe, torch.Generator().manual_seed(seed))
    scenes, geometry, corner = take(scenes, enough), take(geometry, enough), corner[enough]
    b, n, _ = scenes.lights.shape
    if b == 0:
        none = torch.zeros(0, n, 3, w, w, device=device)
        return RenderedBatch(none, scenes.lights, none[:, 0], torch.zeros(0, 1, w, w, dtype=torch.bool, device=device))
    offsets = (torch.arange(w)[:, None] * s + torch.arange(w)).flatten().to(device)
    pixels = (corner[..., None] + offsets).flatten(1)  # (b, c w w)
    I = shaded(scenes, geometry, pixels, recipe, shelf, seed)  # (b, n, 3, c w w)
    I = I.view(b, n, 3, c, w, w).movedim(3, 1).flatten(0, 1)  # (b c, n, 3, w, w)

    def cut(maps: Tensor) -> Tensor:
        return at_points(maps, pixels).view(b, -1, c, w, w).transpose(1, 2).flatten(0, 1)  # (b c, k, w, w)

    N, mask, height = cut(geometry.normals), cut(geometry.mask[:, None]), cut(geometry.height[:, None])
    generator = torch.Generator(device).manual_seed(seed)
    I, L = sensed(I * mask[:, None], scenes.lights, height[:, 0], mask[:, 0], recipe, g, generator)
    return RenderedBatch(I * mask[:, None], L, N, mask)
