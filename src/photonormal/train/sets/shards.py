"""Sets that `photonormal render` wrote as shards: `photonormal.synth.shards`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from photonormal.synth.shards import RECIPE, read_sample, shard_sizes
from photonormal.train.sets import SampleSet, Shape
from photonormal.types import Capture, Normals


class ShardSet(SampleSet):
    """Samples by `file:number`; all are learned from."""

    layout: ClassVar[str] = "shards"
    decoded: ClassVar[bool] = True
    alike: ClassVar[bool] = False

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.sizes = {path.name: sizes for path, sizes in shard_sizes(root).items()}
        self.training = tuple(f"{name}:{i}" for name, (b, *_) in self.sizes.items() for i in range(b))

    @classmethod
    def matches(cls, root: Path) -> bool:
        return (root / RECIPE).is_file() or any(root.glob("*.safetensors"))

    def told(self) -> dict[str, Any]:
        recipe = self.root / RECIPE
        content = recipe.read_bytes() if recipe.is_file() else b""
        told = super().told()
        return told | {"sha256": hashlib.sha256(told["sha256"].encode() + content).hexdigest()}

    def shape(self, key: str) -> Shape:
        _, n, _, h, w = self.sizes[key.rpartition(":")[0]]
        return Shape(n, h, w)

    def read(self, key: str) -> Capture:
        name, _, i = key.rpartition(":")
        batch = read_sample(self.root / name, int(i))
        images, lights, normals, mask = (np.asarray(x[0]) for x in vars(batch).values())
        truth = Normals(np.moveaxis(normals, 0, -1), mask[0])
        return Capture(np.moveaxis(images, 1, -1), mask[0], lights, truth=truth, name=f"{self.name}/{key}")
