"""Rendered batches used more than once: on a processor, rendering a sample costs as much as learning from it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import torch

from photonormal.train.recipes import Recipe


def replayed(source: Callable[..., Iterable], start_step: int, recipe: Recipe) -> Iterator[Any]:
    """Batches from step `start_step` on: every `recipe.reuse` steps a new one, else one of the last `recipe.ring`.

    `source(start_step=k)` yields the rendered batches k, k + 1, ... A resumed training renders its ring again.
    """
    newest = start_step // recipe.reuse
    oldest = newest if recipe.reuse == 1 else max(0, newest - recipe.ring + 1)
    rendered = iter(source(start_step=oldest))
    held = deque((next(rendered) for _ in range(newest + 1 - oldest)), maxlen=recipe.ring if recipe.reuse > 1 else 1)
    step = start_step
    while True:
        if step // recipe.reuse > newest:
            held.append(next(rendered))
            newest += 1
        draw = torch.Generator().manual_seed(hash((recipe.seed, step)) % 2**62)
        fresh = step % recipe.reuse == 0
        yield held[-1 if fresh else int(torch.randint(len(held), (), generator=draw))]
        step += 1
