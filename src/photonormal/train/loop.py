"""The training loop: one page, any network, any stream, one process or several.

    torchrun --nproc-per-node 8 -m photonormal train paper --out runs/paper      (one process per GPU)

Killed at any moment it resumes from its checkpoint and gives the numbers of a training that was never stopped.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from photonormal.capture.lights import read_lights
from photonormal.methods.engine.prior import prior_named
from photonormal.methods.learned.processor import keep_freed_memory
from photonormal.methods.learned.weights import checksum, load_network
from photonormal.options import Count, Positive, Precision, check_value
from photonormal.train import checkpoint, recipes
from photonormal.train.card import command
from photonormal.train.disk import Disk
from photonormal.train.journal import TrainingRecord
from photonormal.train.launch import agreed, launched
from photonormal.train.learner import Learner
from photonormal.train.output import Output, started
from photonormal.train.recipes import Recipe, for_rig
from photonormal.train.replay import replayed
from photonormal.train.validate import examined
from photonormal.types import InputError

log = logging.getLogger(__name__)

CLOCK = 10  # steps between looks at the clock, at most: as many as take a second


def train(
    recipe: str | Recipe,
    out: str | Path,
    minutes: float | None = None,
    steps: int | None = None,
    resume: bool = False,
    device: str = "auto",
    save_seconds: float = 60.0,
    stream: Callable[..., Iterable] | None = None,
    name: str = "",
    seed: int | None = None,
    start_from: str | Path | None = None,
    precision: Precision = "auto",
    data: Sequence[str | Path] = (),
    clock: Callable[[], float] | None = None,
    lights: str | Path | None = None,
) -> Path:
    """Train the network of a recipe; returns the weights file, `out`/NAME.safetensors, its card beside it.

    Parameters
    ----------
    recipe : a key of photonormal.train.recipes.RECIPES, or a Recipe
    out : folder of the checkpoint, the journal (journal.jsonl, TensorBoard) and the weights
    minutes : of learning by the clock, earlier runs of a resumed training counted in; the schedule stretches to them.
        At least one step is learned. Rendering the exams and taking the last of them come on top, and are printed
    steps : length in place of the recipe's
    resume : go on from the checkpoint in `out`
    device : "auto", "cpu" or "cuda"
    save_seconds : between checkpoints
    stream : in place of `photonormal.synth.Stream`, called with (recipe, batch, device, seed, start_step)
    name : of the weights file; empty: the recipe's name
    seed : in place of the recipe's
    start_from : weights file to begin with, of the same network or, where it `widens`, of one half as wide; else random
    precision : "float32" or "bf16" inside the network; "auto": the checkpoint's, or as the machine has instructions for
    data : folders of sets to learn from, in place of rendered scenes (`photonormal.train.sets`); each window is then
        used once, whatever the recipe's `reuse`
    lights : file with the lights of the rig that a network is learned for, of a recipe that asks for one
    clock : seconds that `minutes` are measured by, in place of `time.monotonic`: `time.process_time` for processor time

    Raises
    ------
    InputError
        If the recipe or the device does not exist, an option makes no sense, `out` holds another training, there is
        nothing to resume, or a set lacks something; before anything is trained.
    """
    called = recipe if isinstance(recipe, str) else "RECIPE"
    name = name or (recipe if isinstance(recipe, str) else recipe.network)
    recipe = recipes.recipe(recipe) if isinstance(recipe, str) else recipe
    recipe = recipe if seed is None else replace(recipe, seed=seed)
    recipe = for_rig(recipe, read_lights(Path(lights)).vectors if lights else None)
    out, steps = Path(out), recipe.steps if steps is None else steps
    check_value(steps, Count, "steps")
    check_value(minutes, Positive | None, "minutes")
    for prior, _ in recipe.priors:
        if prior != "truth":
            prior_named(prior)
    if data and (reason := recipe.rendered_only):
        raise InputError(f"--data came but {reason}; leave it out.")
    keep_freed_memory()
    disk = Disk(data, recipe) if data else None
    recipe = replace(recipe, reuse=1) if disk else recipe
    learned_from = disk.told() if disk else []
    state = checkpoint.load(out, recipe.as_dict(), learned_from) if resume else None
    precision = agreed(precision, state, device)
    fabric = launched(device, precision, changing=recipe.once > 0)
    rank, world = fabric.global_rank, fabric.world_size
    if recipe.batch % world:
        raise InputError(f"batch {recipe.batch} can't be shared by {world} processes; choose a divisor of the batch.")
    if recipe.moved < 1 and not start_from:
        raise InputError(f"a recipe with moved={recipe.moved:g} needs weights to begin with; give --start-from FILE.")
    begun = load_network(Path(start_from), recipe.network) if start_from else None
    if disk and rank == 0:
        disk.check()
    if not resume and rank == 0:
        started(out, name)
    stream = stream or rendered()
    learner = Learner(recipe, fabric, begun, state, out)
    step, before = (state["step"], state["seconds"]) if state else (0, 0.0)
    # every process renders its own scenes; each has its own seed
    source = partial(
        disk.stream if disk else stream,
        recipe.stream,
        recipe.batch // world,
        fabric.device,
        recipe.seed * 1000 + rank,
        **recipe.rendered,
    )
    batches = replayed(source, step * recipe.accumulate, recipe)
    exams = examined(stream, fabric.device, recipe, minutes) if rank == 0 else {}
    exams |= disk.exams(recipe.batch, fabric.device) if disk and rank == 0 else {}
    output = None
    if rank == 0:
        angle = recipe.loss if learner.net.learns == "normals" else ""  # of which the journal gives the angle
        journal = TrainingRecord(out, step, steps, minutes, angle)
        output = Output(out, learner, journal, exams, learned_from, precision, save_seconds)
    fabric.barrier()
    clock = clock or time.monotonic
    start = clock()

    def learned() -> float:
        """Seconds of learning, those before a checkpoint counted in."""
        return before + clock() - start

    first = look = step  # at the clock
    spent = 0.0
    while step < steps:
        if step == look:
            seconds = torch.tensor(learned(), device=fabric.device)
            seconds = float(fabric.all_reduce(seconds, reduce_op="max"))  # all processes stop at the same step
            look += max(1, min(CLOCK, int((step - first) / max(seconds - before, 1e-6))))
            spent = seconds / 60
        fraction = max(step / steps, spent / minutes if minutes else 0.0)
        if fraction >= 1 and step:  # never a network of random weights
            break
        share = recipe.share(step, fraction)
        loss = learner.step(batches, step, share)
        step += 1
        if output:
            output.journal.step(step, fraction, loss, share * recipe.lr, recipe.batch * recipe.accumulate)
            output.finish_step(step, learned)
    if output:
        output.save(step, seconds := learned())
        log.info("learned for %.2f minutes, to step %d; exams follow", seconds / 60, step)
        origin = {
            "command": command(called, out, minutes, steps, world, recipe.seed, start_from, name, data, lights),
            "began_with": checksum(Path(start_from)) if start_from else "random weights",
        }
        output.finish(name, step, seconds, origin)
    fabric.barrier()
    return out / f"{name}.safetensors"


def rendered() -> Callable[..., Iterable]:
    """The renderer's stream."""
    from photonormal.synth import Stream

    return Stream
