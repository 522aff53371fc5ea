"""An endless, seeded, resumable stream of windows of samples on disk: the contract of `photonormal.synth.Stream`.

Samples are shuffled anew in every epoch; each time one comes up, other images, another scale and another crop of it
are shown (`photonormal.capture.augmentation`).
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from photonormal.capture.augmentation import augmented
from photonormal.resources import cores
from photonormal.synth import RenderedBatch
from photonormal.synth.params import rng
from photonormal.synth.recipes import parts
from photonormal.train.recipes import Recipe
from photonormal.train.sets import SampleSet, check_samples, fewest_pictures, opened
from photonormal.types import Capture

AHEAD = 3  # batches that are read while the network learns from another
KEPT_BYTES = 2**31  # decoded samples are kept up to this size, by all processes of a machine together
EXAMINED = 1024  # samples of the validation lists, at most
ORDER, WINDOW = 0, 1  # purposes of random numbers


class Disk:
    """Sets of samples on disk, their lists read, and what a recipe shows of them.

    Parameters
    ----------
    folders : of the sets; their samples count alike, so that a larger set is seen more often
    recipe : decides how many images a window has, and how large it is
    """

    def __init__(self, folders: Sequence[str | Path], recipe: Recipe) -> None:
        self.sets = opened(folders)
        self.recipe = recipe
        self.crop = parts(recipe.stream, **recipe.rendering)[0][0].crop
        processes = int(os.environ.get("LOCAL_WORLD_SIZE", 1))
        self.threads = max(1, cores() // processes)
        self.kept, self.room = {}, KEPT_BYTES // processes

    @cached_property
    def images(self) -> int:
        """Images of a window: as many as the recipe shows at most, or as every sample has."""
        return min(self.recipe.images[1], fewest_pictures(self.sets))

    def check(self) -> None:
        """Look at every sample; InputError where one lacks something or the recipe can't show it."""
        check_samples(self.sets, self.recipe.images[0], self.crop)

    def told(self) -> list[dict[str, Any]]:
        """What a checkpoint and a card say of the sets."""
        return [s.told() for s in self.sets]

    def stream(
        self, name: str, batch: int, device: torch.device, seed: int, start_step: int = 0, **rendering: Any
    ) -> Iterator[RenderedBatch]:
        """Batches of training samples for ever, from step `start_step` on; batch k depends on the seed and k alone.

        `name` and `rendering` are for what is rendered (`photonormal.synth.Stream`): samples on disk are as they are.
        """
        samples = [(s, key) for s in self.sets for key in s.training]
        with ThreadPoolExecutor(self.threads) as pool:
            try:
                ahead: deque = deque()
                step = start_step
                while True:
                    while len(ahead) <= AHEAD:
                        places = range(step * batch, (step + 1) * batch)
                        drawn = [samples[i] for i in shuffled(len(samples), seed, places)]
                        generators = [rng(seed, WINDOW, place) for place in places]
                        ahead.append([pool.submit(self.window, *s, g) for s, g in zip(drawn, generators, strict=True)])
                        step += 1
                    yield stacked([future.result() for future in ahead.popleft()], device)
            finally:
                pool.shutdown(cancel_futures=True)

    def exams(self, batch: int, device: torch.device) -> dict[str, list[RenderedBatch]]:
        """A window of each validation sample, the same as `photonormal bench blobby` measures; none: no exam."""
        listed = [(s, key, np.random.default_rng(i)) for s in self.sets for i, key in enumerate(s.validation)]
        if not listed:
            return {}
        chosen = [listed[i] for i in np.unique(np.linspace(0, len(listed) - 1, EXAMINED).astype(int))]
        with ThreadPoolExecutor(self.threads) as pool:
            windows = list(pool.map(lambda given: self.window(*given), chosen))
        parts = (windows[i : i + batch] for i in range(0, len(windows), batch))
        return {"blobby-paper": [stacked(part, device) for part in parts]}

    def window(self, s: SampleSet, key: str, g: np.random.Generator) -> Capture:
        """A random window of a sample."""
        return augmented(self.sample(s, key), g, self.images, self.crop, s.exposed)

    def sample(self, s: SampleSet, key: str) -> Capture:
        """A sample, kept with what is decoded of it as long as there is room."""
        found = self.kept.get((s, key))
        if found is None:
            found = s.read(key)
            size = int(np.prod(found.images.shape)) * np.dtype(found.images.dtype).itemsize  # type: ignore[attr-defined]
            if self.room >= size and not s.decoded:
                self.room -= size
                self.kept[s, key] = found
        return found


def shuffled(n: int, seed: int, places: range) -> list[int]:
    """Which of n samples comes at each place of an endless sequence that has each once an epoch."""
    order = {epoch: rng(seed, ORDER, epoch).permutation(n) for epoch in {place // n for place in places}}
    return [int(order[place // n][place % n]) for place in places]


def stacked(windows: Sequence[Capture], device: torch.device) -> RenderedBatch:
    """Windows of one size with as many images each, as a batch."""
    images = torch.from_numpy(np.stack([np.asarray(w.images) for w in windows])).permute(0, 1, 4, 2, 3)
    lights = torch.from_numpy(np.stack([w.known_lights() for w in windows])).float()
    normals = torch.from_numpy(np.stack([w.truth.map for w in windows])).permute(0, 3, 1, 2)  # type: ignore[union-attr]
    mask = torch.from_numpy(np.stack([w.mask for w in windows]))[:, None]
    images = images.expand(-1, -1, 3, -1, -1)
    return RenderedBatch(*(x.contiguous().to(device) for x in (images, lights, normals, mask)))
