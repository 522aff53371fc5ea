"""What a batch costs beside its measurements: python benchmarks/batch.py [--captures 200] [--method woodham].

Small captures of 12 images, 48 x 48 to 128 x 128 pixels; all processes have one thread. A measurement is from files to
files, as `photonormal measure` does it in a process that has loaded everything.

one     the measurements one after the other in one process that is warm: its loading and a first capture don't count
apart   the same, shared by as many such processes as the batch has, at the same time: what they take from each other
        (memory, disk, clock of the processor) is in here, and nothing of a batch. The slowest, over the seconds of one
        process divided by the processes, is what a batch can reach at best
batch   the command, from its start to its end: loading, looking for captures, measurements and pages, summaries.
        What is to be at most 1.15: this over the seconds of `one` divided by the processes. Beside it: from the first
        result to the last, and the peak memory of the processes, at their first captures and their last
dask    two local workers against one, from the first result to the last
large   one large capture by two workers, each some rows, against one

Seconds are of the clock; "processor" is what the processes that measure have used of it, which other programs don't
change much.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from large import SCENES, frame, render

from photonormal.batch.work import use_threads
from photonormal.batch.workers import beginning
from photonormal.export import load_normals
from photonormal.job import Job, carry_out
from photonormal.resources import cores

LONGEST_S = 3600  # that anything here takes
COMMAND = [sys.executable, "-m", "photonormal"]


def write_capture(folder: Path, size: int, seed: int) -> None:
    """A matt sphere under 12 lights, with some noise."""
    import cv2

    draw = np.random.default_rng(seed)
    phi = 2 * np.pi * np.arange(12) / 12
    L = np.stack([0.6 * np.cos(phi), 0.6 * np.sin(phi), np.full(12, 0.8)], axis=1)
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size] / 0.9
    mask = x**2 + y**2 < 0.9
    n = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    folder.mkdir(parents=True)
    for j, light in enumerate(L):
        level = 0.7 * np.maximum(n @ light, 0) * mask + draw.normal(0, 0.002, mask.shape)
        picture = np.repeat(np.rint(65535 * level.clip(0, 1)).astype(np.uint16)[..., None], 3, axis=-1)
        cv2.imwrite(str(folder / f"{j + 1:02d}.png"), picture)
    np.savetxt(folder / "light_directions.txt", L, fmt="%.8f")
    cv2.imwrite(str(folder / "mask.png"), 255 * mask.astype(np.uint8))


class Spent(NamedTuple):
    """Seconds of some processes that measured: of the slowest by the clock, of all together by the processor."""

    clock: float
    processor: float


def apart(season: Path, out: Path, method: str, processes: int) -> Spent:
    """The measurements of a season, shared by some warm processes."""
    names, context = sorted(p.name for p in season.iterdir()), multiprocessing.get_context("spawn")
    ready, spent = context.Barrier(processes), context.Queue()
    bounds = [len(names) * k // processes for k in range(processes + 1)]
    for first, end in pairwise(bounds):
        work = (season, out, method, names[first:end], ready, spent)
        with beginning():
            context.Process(target=_measure, args=work, daemon=True).start()
    found = [spent.get(timeout=LONGEST_S) for _ in range(processes)]
    return Spent(max(s.clock for s in found), sum(s.processor for s in found))


def _measure(season: Path, out: Path, method: str, names: list[str], ready: Any, spent: Any) -> None:
    """What one of them does."""
    use_threads(1)
    carry_out(Job(season / names[0], out / f"warm-{names[0]}", method=method))
    ready.wait(LONGEST_S)
    clock, processor = time.monotonic(), time.process_time()
    for name in names:
        carry_out(Job(season / name, out / name, method=method))
    spent.put(Spent(time.monotonic() - clock, time.process_time() - processor))


class Run(NamedTuple):
    """Seconds of a command from its start to its end, to its first result and from there to its last; the processor's
    of the processes that measured; and what it told of each capture."""

    whole: float
    first: float
    between: float
    processor: float
    done: list[dict]


def run(season: Path, out: Path, *words: str) -> Run:
    """The command over a season."""
    start = time.monotonic()
    command = [*COMMAND, "batch", str(season / "*"), "--out", str(out), "--json-lines", *words]
    done: list[dict] = []
    at: dict[str, float] = {}  # when a capture was begun
    used: dict[str, float] = {}  # by each process
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            event, now = json.loads(line), time.monotonic()
            if event["event"] == "begun":
                at[event["capture"]] = now
                used[event["where"]] = _processor(event["where"])
            if event["event"] == "done":
                done.append(event | {"at": now, "elapsed": now - at[event["capture"]]})
                used = {where: _processor(where) or before for where, before in used.items()}
            if event["event"] == "summary":
                break  # what its processes are forked of ends after the command, and holds its output until then
        assert process.wait() == 0
        end = time.monotonic()
    first, last = done[0]["at"], done[-1]["at"]
    return Run(end - start, first - start, last - first, sum(used.values()), done)


def _processor(where: str) -> float:
    """Seconds of the processor that a process has used; 0 where it has ended, or is a cluster's."""
    import psutil

    kind, _, number = where.partition(" ")
    try:
        return sum(psutil.Process(int(number)).cpu_times()[:2]) if kind == "process" else 0.0
    except psutil.NoSuchProcess:
        return 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=200)
    parser.add_argument("--method", default="woodham")
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument(
        "--parts",
        nargs="*",
        default=["one", "apart", "batch", "dask"],
        choices=["one", "apart", "batch", "dask", "large"],
    )
    parser.add_argument("--megapixels", type=float, default=24, help="of the large capture")
    parser.add_argument("--images", type=int, default=6, help="of it")
    parser.add_argument("--scene", choices=SCENES, default="turned", help="of it")
    parser.add_argument("--large-method", default="normalnet", help="which it is measured by")
    parser.add_argument("--words", nargs="*", default=[], help="more options for it, such as --words=--no-mesh")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        season, n = Path(place) / "season", given.captures
        for k in range(n):
            write_capture(season / f"{k:03d}", 48 + 16 * (k % 6), k)
        method, single = ("--method", given.method), None
        if "one" in given.parts:
            single = apart(season, Path(place) / "one", given.method, 1)
            tell(f"{n} measurements in one warm process", single, n)
        if "apart" in given.parts:
            floor = apart(season, Path(place) / "apart", given.method, given.jobs)
            tell(f"shared by {given.jobs} warm processes at the same time", floor, n)
            if single:
                print(f"  {floor.clock * given.jobs / single.clock:.2f} times those of one over the processes")
        if "batch" in given.parts:
            batch(season, Path(place) / "batch", given, single)
        if "dask" in given.parts:
            spans = {}
            for workers in (1, 2):
                with scheduler(workers) as client:
                    out = Path(place) / f"dask-{workers}"
                    spent = run(season, out, *method, "--scheduler", client.scheduler.address)
                spans[workers] = spent.between
                print(f"{workers} Dask workers: {spent.between:.1f} s from the first result to the last", flush=True)
            print(f"  two against one: {spans[1] / spans[2]:.2f} times")
        if "large" in given.parts:
            large(Path(place), given)


def tell(what: str, spent: Spent, captures: int) -> None:
    """A line of the table."""
    clock, processor = (1000 * seconds / captures for seconds in spent)
    print(f"{what}: {spent.clock:.1f} s; a capture {clock:.0f} ms, processor {processor:.0f} ms", flush=True)


def batch(season: Path, out: Path, given: argparse.Namespace, single: Spent | None) -> None:
    """The command over the season, and once more with nothing to do."""
    n, words = given.captures, ("--method", given.method)
    spent = run(season, out, *words, "--jobs", str(given.jobs))
    tell(f"batch of {given.jobs} processes", Spent(spent.whole, spent.processor), n)
    print(f"  first result after {spent.first:.1f} s, the last {spent.between:.1f} s later")
    if single:
        share = single.clock / given.jobs
        print(f"  {spent.whole / share:.2f} times the seconds of one process over the processes,", end="")
        print(f" {spent.between / share:.2f} times from the first result to the last")
        print(f"  {1000 * (spent.whole - share) / n:.0f} ms more for each capture, loading included")
    reports = [json.loads((out / e["capture"] / "report.json").read_text()) for e in spent.done]
    memory, tenth = [told["peak_memory_mb"] for told in reports], max(1, n // 10)
    first, last = np.median(memory[tenth : 2 * tenth]), np.median(memory[-tenth:])
    print(f"  peak memory: {first:.0f} MB in the second tenth, {last:.0f} MB in the last", flush=True)
    start = time.monotonic()
    again = subprocess.run([*COMMAND, "batch", str(season / "*"), "--out", str(out), *words], check=False)
    print(f"  run again, with nothing to do: {time.monotonic() - start:.1f} s, code {again.returncode}")


@contextmanager
def scheduler(workers: int) -> Iterator[Any]:
    """A cluster of this machine, whose workers have one thread and half of the free memory each; a client of it."""
    import psutil
    from distributed import Client, LocalCluster

    half = psutil.virtual_memory().available // 2
    with (
        LocalCluster(
            n_workers=workers, threads_per_worker=1, memory_limit=half, dashboard_address="", silence_logs=50
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def large(place: Path, given: argparse.Namespace) -> None:
    """One large capture by one worker, and by two of which each solves some rows. Seconds are those of the clock, and
    of the processor: of the worker that took most, which is the one that joined the rows."""
    h, w = frame(given.megapixels)
    render(place / "large" / "one", given.scene, h, w, given.images, "jpg")
    seconds, processor, normals = {}, {}, {}
    for workers in (1, 2):
        out = place / f"large-{workers}"
        words = ("--method", given.large_method, "--split-megapixels", "1", *given.words)
        with scheduler(workers) as client:
            before = client.run(time.process_time)
            (done,) = run(place / "large", out, *words, "--scheduler", client.scheduler.address).done
            seconds[workers] = done["elapsed"]
            processor[workers] = max(used - before[who] for who, used in client.run(time.process_time).items())
        normals[workers] = load_normals(out / "one").map
        told = json.loads((out / "one" / "report.json").read_text())["seconds"]
        print(
            f"{w} x {h}, {workers} workers: {seconds[workers]:.1f} s, processor {processor[workers]:.1f} s", flush=True
        )
        print(f"  in the stages {told}", flush=True)
    apart = np.abs(normals[1] - normals[2]).max()
    times = [spent[1] / spent[2] for spent in (seconds, processor)]
    print(f"  two against one: {times[0]:.2f} times, by the processor {times[1]:.2f}; normals differ by {apart:.1e}")


if __name__ == "__main__":
    main()
