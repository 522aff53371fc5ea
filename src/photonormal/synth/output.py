"""Renders a set into a folder: what ``photonormal render`` does."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch

from photonormal.disk import PARTIAL, at_once
from photonormal.png import encode_png
from photonormal.synth.layout import BlobbyWriter, RenderedObject, write_diligent
from photonormal.synth.params import rng
from photonormal.synth.preview import contact_sheet
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
    made = dataclasses.replace(made, scenes=min(made.scenes, -(-count // made.crops)))
    shown: list[RenderedBatch] = []
    done = 0
    with at_once(out, wait_seconds=0) as folder:
        if any(p.name != PARTIAL for p in out.iterdir()):
            raise InputError(f"{out} already exists and isn't an empty folder; give another one.")
        blobby = BlobbyWriter(folder) if layout == "blobby" else None
        for index, batch in enumerate(_batches(made, count, device, seed)):
            if layout == "shards":
                write_shard(folder, index, batch)
            else:
                for number, rendered in enumerate(_objects(batch), done):
                    if blobby:
                        blobby.write(f"{label}{number:06d}", "rendered", rendered)
                    else:
                        place = folder.inside(f"{label}_{number + 1:04d}")
                        write_diligent(place, rendered, _intensities(seed, number, len(rendered.lights)), bits=12)
            if sum(len(b.mask) for b in shown) < SHOWN:
                shown.append(batch)
            done += len(batch.mask)
            if progress:
                progress(done, count)
        if layout == "shards":
            write_recipe(folder, {"name": label, "seed": seed, "count": count, **dataclasses.asdict(made)})
        if preview:
            folder.write("contact-sheet.png", encode_png(contact_sheet(shown)))
    return out


def _batches(made: Rendering, count: int, device: torch.device | str, seed: int) -> Iterator[RenderedBatch]:
    """So many samples in all."""
    left = count
    for batch in Stream(made, min(SHARD, made.scenes * made.crops), device, seed):
        yield RenderedBatch(*(getattr(batch, f.name)[:left] for f in dataclasses.fields(batch)))
        left -= len(batch.mask)
        if left <= 0:
            return


def _objects(batch: RenderedBatch) -> Iterator[RenderedObject]:
    """The samples of a batch, one after the other."""
    for images, lights, normals, mask in zip(batch.images, batch.lights, batch.normals, batch.mask, strict=True):
        yield RenderedObject(
            images.permute(0, 2, 3, 1).cpu().numpy(),
            lights.cpu().numpy().astype(np.float64),
            normals.permute(1, 2, 0).cpu().numpy(),
            mask[0].cpu().numpy(),
        )


def _intensities(seed: int, number: int, n: int) -> np.ndarray:
    """(n, 3) of a sample: lamps are never quite alike."""
    g = rng(seed, number)
    return g.uniform(0.8, 1, (n, 1)) * g.normal(1, 0.03, (n, 3))
