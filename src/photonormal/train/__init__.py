"""Training: a recipe, a stream of rendered scenes, one loop. `train` loads torch only when called."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from photonormal.train.recipes import Recipe


def train(recipe: str | Recipe, out: str | Path, **options: Any) -> Path:
    """Train the network of a recipe, given or named; the options are those of `photonormal.train.loop.train`."""
    from photonormal.train.loop import train as run

    return run(recipe, out, **options)
