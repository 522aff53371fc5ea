"""Whether reading keeps up with learning: windows a second from disk, from the renderer, and in training steps.

    python benchmarks/disk.py [--recipe paper] [--samples 48] [--seconds 20] [--device cpu|cuda] [--set FOLDER]

Writes a set in the layout of Blobby and Sculpture (64 pictures of 128 x 128 a sample) into a temporary folder, or takes
the one given. Cases take turns, three rounds each, the last two counted: per second, and per second of one processor,
which says more on a machine that others use, too.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from classical import print_row

from photonormal.methods.engine.device import torch_device
from photonormal.methods.learned.network import placed
from photonormal.methods.learned.processor import computing_in, inner_precision
from photonormal.methods.learned.weights import build
from photonormal.synth import Stream, render
from photonormal.train import disk as reading
from photonormal.train.disk import Disk
from photonormal.train.observe import observe
from photonormal.train.optimiser import Optimiser
from photonormal.train.recipes import RECIPES, Recipe

ROUNDS = 3  # of every case; the first warms up


def steps(recipe: Recipe, device: torch.device) -> Iterator[Any]:
    """Training steps of a recipe on one batch, for ever."""
    batch = next(iter(Stream(recipe.stream, recipe.batch, device, lights=recipe.images[1:] * 2, **recipe.rendering)))
    net = placed(build(recipe.network, recipe.config), device)
    optimiser = Optimiser(net, recipe)
    while True:
        seen = observe(batch, recipe, net.scaling, 0)
        with inner_precision(device):
            found = net(seen.images, seen.lights, seen.prior, recipe.passes)[:, :3]
        loss = ((1 - (found * seen.normals.repeat(recipe.passes, 1, 1, 1)).sum(1)) * seen.mask[:, 0]).mean()
        net.zero_grad()
        loss.backward()
        optimiser.step(1e-3)
        yield loss.item()  # waits for a GPU


def measured(cases: dict[str, Callable[[], Iterator]], batch: int, budget: float) -> dict[str, tuple[float, float]]:
    """Windows a second and a second of one processor."""
    running = {name: make() for name, make in cases.items()}
    counted = dict.fromkeys(cases, (0, 0.0, 0.0))
    for turn in range(ROUNDS):
        for name, batches in running.items():
            done, start, busy = 0, time.perf_counter(), time.process_time()
            while done == 0 or time.perf_counter() - start < budget / ROUNDS:
                next(batches)
                done += batch
            spent, used = time.perf_counter() - start, time.process_time() - busy
            if turn:
                n, a, b = counted[name]
                counted[name] = (n + done, a + spent, b + used)
    for batches in running.values():
        batches.close()  # type: ignore[attr-defined]
    return {name: (n / a, n / b) for name, (n, a, b) in counted.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recipe", choices=RECIPES, default="paper")
    parser.add_argument("--samples", type=int, default=48)
    parser.add_argument("--seconds", type=float, default=20.0, help="for each figure")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--set", type=Path, dest="folder")
    given = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    device, recipe = torch_device(given.device), replace(RECIPES[given.recipe], reuse=1)
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or render("blobby", given.samples, Path(temporary) / "set")
        held = Disk([folder], recipe)
        held.check()
        again = Disk([folder], recipe)
        again.room = 0

        def read(source: Disk) -> Callable[[], Iterator]:
            return lambda: source.stream("", recipe.batch, device, 0)

        def stream() -> Iterator:
            n = recipe.images[1]
            return iter(Stream(recipe.stream, recipe.batch, device, lights=(n, n), **recipe.rendering))

        cases = {
            "from disk, every picture decoded": read(again),
            "from disk, kept in memory": read(held),
            "from the renderer": stream,
            f"training steps of {given.recipe}": lambda: steps(recipe, device),
        }
        with computing_in("auto"):
            found = measured(cases, recipe.batch, given.seconds)
    print(f"\n{device}, {reading.cores()} processors, windows of {held.crop} x {held.crop}, {held.images} images\n")
    print_row("windows", "a second", "a second of one processor")
    print_row("---", "---", "---")
    for name, (rate, per_core) in found.items():
        print_row(name, f"{rate:.1f}", f"{per_core:.1f}")


if __name__ == "__main__":
    main()
