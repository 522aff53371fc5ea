"""Rendered sets on disk, compact: safetensors files of some samples each, 16 bits a value, and the recipe beside them.

SET/
    recipe.json                 fields of the recipe, seed, samples
    00000.safetensors ...       images (b, n, 3, h, w) uint16, lights (b, n, 3) float32,
                                normals (b, 3, h, w) int16, mask (b, 1, h, w) uint8
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

from photonormal.synth.stream import Batch
from photonormal.types import InputError


def write_shard(folder: Path, index: int, batch: Batch) -> None:
    """One batch as file `index` of a set; images are in [0, 1]."""
    from safetensors.torch import save_file

    tensors = {
        "images": (batch.images.clamp(0, 1) * 65535).round().to(torch.int32).to(torch.uint16),
        "lights": batch.lights,
        "normals": (batch.normals * 32767).round().to(torch.int16),
        "mask": batch.mask.to(torch.uint8),
    }
    save_file({k: v.cpu().contiguous() for k, v in tensors.items()}, Path(folder) / f"{index:05d}.safetensors")


def write_recipe(folder: Path, fields: dict[str, Any]) -> None:
    """What the set was rendered by."""
    (Path(folder) / "recipe.json").write_text(json.dumps(fields, indent=1) + "\n")


def read_shards(folder: Path, device: torch.device | str = "cpu") -> Iterator[Batch]:
    """The batches of a set, in order."""
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    paths = sorted(Path(folder).glob("*.safetensors"))
    if not paths:
        raise InputError(f"{folder} holds no .safetensors; give a set that `photonormal render` wrote.")
    for path in paths:
        try:
            t = load_file(path, str(device))
            images = t["images"].to(torch.int32).float() / 65535
            normals = torch.nn.functional.normalize(t["normals"].float(), dim=1)
            yield Batch(images, t["lights"], normals, t["mask"].bool())
        except (SafetensorError, KeyError) as error:
            raise InputError(f"{path} is not a shard of a rendered set ({error}); render it again.") from None
