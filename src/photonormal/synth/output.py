"""Renders a set into a folder: what ``photonormal render`` does."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from photonormal import disk
from photonormal.disk import PARTIAL, at_once
from photonormal.synth.layout import BlobbyWriter, write_diligent
from photonormal.synth.params import rng
from photonormal.synth.preview import contact_sheet, encode_sheet
from photonormal.synth.recipes import Rendering, recipe
from photonormal.synth.shards import write_recipe, write_shard
from photonormal.synth.stream import RenderedBatch, Stream
from photonormal.types import InputError

LAYOUTS = ("diligent", "blobby", "shards")
SHOWN = 24  # samples on a contact sheet at most
SHARD = 64  # samples in a file


def render(
    name: str | Rendering,
    count: int,
    out: Path | str,
    preview: bool = False,
    progress: Callable[[int, int], None] | None = None,
    layout: str | None = None,
    device: torch.device | str = "cpu",
    seed: int = 0,
) -> Path:
    """Write `count` samples of a recipe into the new folder `out`, whole or not at all.

    Parameters
    ----------
    name : a recipe or its name
    count : samples
    out : must not exist yet, or be empty
    preview : also write contact-sheet.png, of the first samples
    progress : called with (samples done, count)
    layout : "diligent" (a folder each, for `photonormal measure`), "blobby" or "shards"; None: the recipe's own
    device, seed : as `Stream` takes them

    Returns
    -------
    The folder.

    Raises
    ------
    InputError
        If the recipe, layout or count makes no sense, or the folder can't be written or isn't empty.
    """
    made = recipe(name)
    layout = layout or made.layout
    if layout not in LAYOUTS:
        raise InputError(f"no layout {layout!r}; use {', '.join(LAYOUTS)}.")
    if count < 1:
        raise InputError(f"{count} samples were asked for but at least one is needed; change --count.")
    out = Path(out)
    label = name if isinstance(name, str) else "custom"
    with at_once(out, wait_seconds=0) as folder:
        if any(p.name != PARTIAL for p in out.iterdir()):
            raise InputError(f"{out} already exists and isn't an empty folder; give another one.")
        _write(made, label, count, folder, preview, progress, layout, device, seed)
    return out


def _write(
    made: Rendering,
    label: str,
    count: int,
    folder: disk.FileBatch,
    preview: bool,
    progress,
    layout: str,
    device,
    seed: int,
) -> None:
    block = min(made.scenes, -(-count // made.crops))
    made = dataclasses.replace(made, scenes=block)
    size = min(SHARD, block * made.crops)
    blobby = BlobbyWriter(folder) if layout == "blobby" else None
    shown: list[RenderedBatch] = []
    done = 0
    for index, batch in enumerate(Stream(made, size, device, seed)):
        batch = RenderedBatch(*(getattr(batch, f.name)[: count - done] for f in dataclasses.fields(batch)))
        if layout == "shards":
            write_shard(folder, index, batch)
        else:
            for i in range(len(batch.mask)):
                write_sample(batch, i, done + i, label, folder, blobby, seed)
        if sum(len(b.mask) for b in shown) < SHOWN:
            shown.append(batch)
        done += len(batch.mask)
        if progress:
            progress(done, count)
        if done >= count:
            break
    if layout == "shards":
        write_recipe(folder, {"name": label, "seed": seed, "count": count, **dataclasses.asdict(made)})
    if preview:
        folder.write("contact-sheet.png", encode_sheet(contact_sheet(shown)))


def write_sample(
    batch: RenderedBatch,
    i: int,
    index: int,
    label: str,
    folder: disk.FileBatch,
    blobby: BlobbyWriter | None,
    seed: int = 0,
) -> None:
    """Sample `i` of a batch as number `index` of a set."""
    images = batch.images[i].permute(0, 2, 3, 1).cpu().numpy()  # (n, h, w, 3)
    normals = batch.normals[i].permute(1, 2, 0).cpu().numpy()
    lights, mask = batch.lights[i].cpu().numpy().astype(np.float64), batch.mask[i, 0].cpu().numpy()
    if blobby:
        blobby.write(f"{label}{index:06d}", "rendered", images, lights, normals, mask)
        return
    g = rng(seed, index)
    n = len(lights)
    intensities = g.uniform(0.8, 1, (n, 1)) * g.normal(1, 0.03, (n, 3))  # lamps are never quite alike
    write_diligent(folder.inside(f"{label}_{index + 1:04d}"), images, lights, normals, mask, intensities, bits=12)
