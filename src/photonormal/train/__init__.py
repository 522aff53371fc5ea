"""Training: a recipe, a stream of rendered scenes, one loop. `train` loads torch only when called."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def train(recipe: str, out: str | Path, **options: Any) -> Path:
    """Train the network of a recipe; see `photonormal.train.loop.train`, which this calls, for the options."""
    from photonormal.train.loop import train as run

    return run(recipe, out, **options)
