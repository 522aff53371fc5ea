"""Run methods over a benchmark's objects, once, and store what they predict."""

from __future__ import annotations

import logging
import multiprocessing
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from photonormal.batch.workers import began
from photonormal.bench.benchmarks import Item, items
from photonormal.bench.contest import Entry, entries
from photonormal.bench.selections import Plan, Selection, selected
from photonormal.bench.store import (
    Truth,
    check_config,
    prediction_path,
    truth_path,
    write_prediction,
    write_truth,
)
from photonormal.export.mesh import display
from photonormal.lighting import frontal
from photonormal.options import Precision
from photonormal.progress import progress
from photonormal.resources import cores
from photonormal.types import Capture, InputError, code_of_others

log = logging.getLogger(__name__)


@dataclass
class RunOutcome:
    """What a run did: predictions made, predictions that were there, and what failed, a line each."""

    predicted: int = 0
    kept: int = 0
    failures: list[str] = field(default_factory=list)

    def add(self, other: RunOutcome) -> None:
        self.predicted += other.predicted
        self.kept += other.kept
        self.failures += other.failures


@dataclass(frozen=True)
class HowPredicted:
    """What is done with every object."""

    contest: list[Entry]
    plan: Plan
    out: Path
    device: str
    precision: Precision
    jobs: int


def bench(
    benchmark: str,
    root: str | Path,
    out: str | Path,
    methods: str = "all",
    images: str = "all",
    draws: int = 10,
    fixed: tuple[Path, ...] = (),
    objects: str = "",
    device: str = "auto",
    jobs: int = 1,
    precision: Precision = "auto",
    srgb: bool = False,
) -> RunOutcome:
    """Predict normals of a benchmark's objects and store them; what is stored already is not predicted again.

    Parameters
    ----------
    benchmark : a key of photonormal.bench.benchmarks.BENCHMARKS
    root : folder with its objects; those that are absent are left out
    out : folder of the predictions, see photonormal.bench.store
    methods : "all", or see photonormal.bench.contest.entries
    images : "all", or counts like "10" or "8,16,96"
    draws : random draws of each count below an object's images, besides the one that PS-FCN's code makes
    fixed : files with image numbers, see photonormal.bench.selections.read_fixed
    objects : names of some of the objects, "ball,cat"; "": all
    device : "auto", "cpu" or "cuda"
    jobs : objects at a time, each in its own process with its share of the cores; seconds suffer from each other
    precision : what networks compute in, "float32" or "bf16"; "auto": bf16 where the machine has instructions for it
    srgb : the photographs of `captures` are sRGB-encoded, whatever their files say

    Returns
    -------
    RunOutcome; an object or a method that fails is one of its failures, and the others go on.

    Raises
    ------
    InputError
        If the root holds no objects, a method, option or count can't be used, or `out` holds predictions that were
        made in another way. Nothing has been predicted then.
    """
    from photonormal.methods.engine.device import torch_device

    torch_device(device)
    plan = Plan.parse(images, draws, fixed)
    contest = entries(methods)
    if srgb and benchmark != "captures":
        raise InputError(
            f"--srgb is for `bench captures` but {benchmark} says how its pictures are stored; leave it out."
        )
    chosen = [replace(item, srgb=srgb) for item in _named(items(benchmark, Path(root)), objects)]
    if jobs < 1:
        raise InputError(f"--jobs {jobs} came but 1 or more are needed.")
    outcome = RunOutcome()
    ready = []
    for entry in contest:
        try:
            config = entry.config()
        except InputError as error:
            outcome.failures.append(f"{entry.label}: {error}")
            continue
        for dataset in dict.fromkeys(i.dataset for i in chosen):
            made = {**config, "benchmark": benchmark, "precision": precision, "srgb": srgb}
            check_config(Path(out) / entry.label / dataset, made)
        ready.append(entry)
    run = partial(run_object, how=HowPredicted(ready, plan, Path(out), device, precision, jobs))
    with progress(f"{benchmark}: {len(chosen)} objects", len(chosen)) as advance:
        for done in _each(run, chosen, jobs):
            outcome.add(done)
            advance()
    return outcome


def run_object(item: Item, how: HowPredicted) -> RunOutcome:
    """Every method on every selection of one object."""
    outcome = RunOutcome()
    try:
        capture = item.load()
        selections = how.plan.of(item, capture.images.shape[0])
        kept = truth_path(how.out, item.dataset, item.name)
        if not kept.is_file():
            write_truth(kept, truth_of(capture))
        unlit = item.load(lights=False) if any(e.solver().needs.finds_lights for e in how.contest) else None
    except InputError as error:
        outcome.failures.append(f"{item.dataset}, {item.name}: {error}")
        return outcome
    read: float | None = None
    for entry in how.contest:
        shown = unlit if unlit is not None and entry.solver().needs.finds_lights else capture
        for selection in selections:
            path = prediction_path(how.out, entry.label, item.dataset, item.name, selection.name)
            if path.is_file():
                outcome.kept += 1
                continue
            try:
                if read is None:
                    read = _read(capture)
                _predict(path, item, shown, entry, selection, read, how)
                outcome.predicted += 1
            except Exception as error:  # whatever a method fails with, the others go on
                log.debug("%s on %s", entry.label, item.name, exc_info=True)
                what = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
                what += f" ({place})" if (place := code_of_others(error)) else ""
                outcome.failures.append(
                    f"{item.dataset}, {item.name}: {entry.label}: {' '.join(what.splitlines())[:300]}"
                )
                break  # its other draws would fail in the same way
    return outcome


def truth_of(capture: Capture) -> Truth:
    """What its predictions are compared with."""
    photograph = capture.images[frontal(capture.lights)]
    white = float(np.quantile(photograph[capture.mask], 0.99)) or 1.0
    shown = display(np.broadcast_to(photograph / white, (*capture.mask.shape, 3)))
    return Truth(capture.truth, capture.mask, shown)


def _predict(
    path: Path,
    item: Item,
    capture: Capture,
    entry: Entry,
    selection: Selection,
    read_s: float,
    how: HowPredicted,
) -> None:
    """One method on one selection, measured and stored."""
    from photonormal.measurement import measure
    from photonormal.methods.engine.device import torch_device
    from photonormal.resources import gpu_peak_mb, peak_mb, processor, reset_peak

    where = torch_device(how.device)
    part = selected(capture, selection)
    reset_peak()
    normals_only: Any = {"integration": None, "albedo": False, "expected_error": False, "examine": False}
    result = measure(part, entry.method, how.device, entry.options, precision=how.precision, **normals_only)
    normals, seconds = result.normals, dict(result.report["seconds"])
    if selection.protocol == "all":
        seconds["read"] = read_s
    record = {
        "object": item.name,
        "dataset": item.dataset,
        "selection": selection.name,
        "protocol": selection.protocol,
        "images": list(part.image_names),
        "pixels": {"mask": int(part.mask.sum()), "measured": int(normals.mask.sum())},
        "seconds": seconds,
        "peak_memory_mb": peak_mb(),
        "gpu_memory_mb": gpu_peak_mb() if where.type == "cuda" else None,
        "device": str(where),
        "precision": result.report["precision"],
        "processor": processor(),
        "cores": cores(),
        "jobs": how.jobs,
    }
    write_prediction(path, normals, record, half=selection.protocol == "draws")


def _read(capture: Capture) -> float:
    """Decode every picture once; the seconds that took."""
    start = time.perf_counter()
    capture.map_images(lambda j, image: None)
    return round(time.perf_counter() - start, 4)


def _named(found: list[Item], names: str) -> list[Item]:
    wanted = [n.strip() for n in names.split(",") if n.strip()]
    for name in wanted:
        if name not in {i.name for i in found}:
            raise InputError(f"no object {name!r} in this root; it has {', '.join(i.name for i in found[:20])}.")
    return [i for i in found if not wanted or i.name in wanted]


def _each(run: partial[RunOutcome], chosen: list[Item], jobs: int) -> Iterator[RunOutcome]:
    """The outcome of each object, as they come."""
    if jobs == 1:
        yield from map(run, chosen)
        return
    threads = max(1, cores() // jobs)
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=began, initargs=(threads,))
    try:
        waiting = {pool.submit(run, item): item for item in chosen}
        for future in as_completed(waiting):
            try:
                yield future.result()
            except BrokenProcessPool:
                item = waiting[future]
                yield RunOutcome(failures=[f"{item.dataset}, {item.name}: a process ended early; use fewer --jobs."])
    except BaseException:
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
