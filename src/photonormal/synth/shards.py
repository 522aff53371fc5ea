"""Rendered sets on disk, compact: safetensors files of some samples each, 16 bits a value, and the recipe beside them.

SET/
    recipe.json                 fields of the recipe, seed, samples
    00000.safetensors ...       images (b, n, 3, h, w) uint16, lights (b, n, 3) float32,
                                normals (b, 3, h, w) int16, mask (b, 1, h, w) uint8
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from photonormal import disk
from photonormal.synth.stream import RenderedBatch
from photonormal.types import InputError

RECIPE = "recipe.json"
TENSORS = ("images", "lights", "normals", "mask")


def write_shard(folder: disk.FileBatch, index: int, batch: RenderedBatch) -> None:
    """One batch as file `index` of a set; images are in [0, 1]."""
    from safetensors.torch import save

    tensors = {
        "images": (batch.images.clamp(0, 1) * 65535).round().to(torch.int32).to(torch.uint16),
        "lights": batch.lights,
        "normals": (batch.normals * 32767).round().to(torch.int16),
        "mask": batch.mask.to(torch.uint8),
    }
    folder.write(f"{index:05d}.safetensors", save({k: v.cpu().contiguous() for k, v in tensors.items()}))


def write_recipe(folder: disk.FileBatch, fields: dict[str, Any]) -> None:
    """What the set was rendered by."""
    folder.write(RECIPE, (json.dumps(fields, indent=1) + "\n").encode())


def shard_sizes(folder: Path) -> dict[Path, list[int]]:
    """The files of a set, in order, and the shape of the images in each, (b, n, 3, h, w), by its header."""
    paths = sorted(Path(folder).glob("*.safetensors"))
    if not paths:
        raise InputError(f"{folder} holds no .safetensors; give a set that `photonormal render` wrote.")
    sizes = {}
    for path in paths:
        with _opened(path) as file:
            stored = [file.get_slice(name) for name in TENSORS]
            shapes, kinds = ([getattr(s, what)() for s in stored] for what in ("get_shape", "get_dtype"))
        b, n, _, h, w = shapes[0] if len(shapes[0]) == 5 else [0] * 5
        needed = [[b, n, 3, h, w], [b, n, 3], [b, 3, h, w], [b, 1, h, w]]
        if not b or shapes != needed or kinds != ["U16", "F32", "I16", "U8"]:
            found = ", ".join(f"{name} {k} {s}" for name, k, s in zip(TENSORS, kinds, shapes, strict=True))
            raise InputError(f"{path} is not a shard of a rendered set (it holds {found}); render it again.")
        sizes[path] = shapes[0]
    return sizes


def read_sample(path: Path, i: int) -> RenderedBatch:
    """Sample `i` of a file, as a batch of one; nothing else of the file is read."""
    with _opened(path) as file:
        images, lights, normals, mask = (file.get_slice(name)[i : i + 1] for name in TENSORS)
    normals = torch.nn.functional.normalize(normals.float(), dim=1)
    return RenderedBatch(images.to(torch.int32).float() / 65535, lights, normals, mask.bool())


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt") as file:
            yield file
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is not a shard of a rendered set ({error}); render it again.") from None
