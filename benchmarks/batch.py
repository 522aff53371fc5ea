"""What a batch costs beside its measurements: python benchmarks/batch.py [--captures 200] [--method woodham].

Small captures of 12 images, 48 x 48 to 128 x 128 pixels. Told are: the seconds of the same measurements one after the
other in one warm process; the batch over them, and the time that it needs more than those seconds divided by its
processes; the memory of its processes, at their first captures and their last; and two local Dask workers against one.
`--parts large` measures one large capture by two workers, each some rows, and by one. All workers have one thread.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from large import SCENES, frame, render

from photonormal.export import load_normals
from photonormal.job import Job, carry_out
from photonormal.types import cores

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


def run(season: Path, out: Path, *words: str) -> tuple[float, float, list[dict]]:
    """The command's seconds, those from its first capture to its last, and what it told of each."""
    start = time.monotonic()
    command = [*COMMAND, "batch", str(season / "*"), "--out", str(out), "--json-lines", *words]
    events, begun, ended = [], 0.0, 0.0
    at: dict[str, float] = {}  # when a capture was begun
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            events.append(json.loads(line))
            if events[-1]["event"] == "begun":
                at[events[-1]["capture"]] = time.monotonic()
            if events[-1]["event"] == "done":
                events[-1]["elapsed"] = time.monotonic() - at[events[-1]["capture"]]
            ended = time.monotonic() if events[-1]["event"] == "done" else ended
            begun = begun or (time.monotonic() if events[-1]["event"] == "done" else 0.0)
    assert process.returncode == 0, events[-1]
    return time.monotonic() - start, ended - begun, [e for e in events if e["event"] == "done"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=200)
    parser.add_argument("--method", default="woodham")
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument(
        "--parts", nargs="*", default=["one", "batch", "dask"], choices=["one", "batch", "dask", "large"]
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
        names, method = sorted(p.name for p in season.iterdir()), ("--method", given.method)
        single = 0.0
        if "one" in given.parts:
            carry_out(Job(season / names[0], Path(place) / "warm", method=given.method))
            start = time.monotonic()
            for name in names:
                carry_out(Job(season / name, Path(place) / "one" / name, method=given.method))
            single = time.monotonic() - start
            print(f"{n} measurements in one warm process: {single:.1f} s, {1000 * single / n:.0f} ms each", flush=True)
        if "batch" in given.parts:
            out = Path(place) / "batch"
            whole, between, done = run(season, out, *method, "--jobs", str(given.jobs))
            memory = [json.loads((out / e["capture"] / "report.json").read_text())["peak_memory_mb"] for e in done]
            tenth = max(1, n // 10)
            first, last = np.median(memory[tenth : 2 * tenth]), np.median(memory[-tenth:])
            print(f"batch of {given.jobs} processes: {whole:.1f} s, {between:.1f} s from its first result to its last")
            if single:
                share = single / given.jobs
                print(f"  {whole / share:.2f} times, {between / share:.2f} times the single ones over the processes")
                print(f"  {1000 * (whole - share) / n:.0f} ms more for each capture, loading included")
            print(f"  peak memory: {first:.0f} MB in the second tenth, {last:.0f} MB in the last", flush=True)
            again = time.monotonic()
            run_again = subprocess.run([*COMMAND, "batch", str(season / "*"), "--out", str(out), *method], check=False)
            print(f"  run again, with nothing to do: {time.monotonic() - again:.1f} s, code {run_again.returncode}")
        if "dask" in given.parts:
            spans = {}
            for workers in (1, 2):
                with scheduler(workers) as client:
                    out = Path(place) / f"dask-{workers}"
                    whole, spans[workers], _ = run(season, out, *method, "--scheduler", client.scheduler.address)
                print(f"{workers} Dask workers: {whole:.1f} s, {spans[workers]:.1f} s from first to last", flush=True)
            print(f"  two against one: {spans[1] / spans[2]:.2f} times, from the first result to the last")
        if "large" in given.parts:
            large(Path(place), given)


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
            _, _, (done,) = run(place / "large", out, *words, "--scheduler", client.scheduler.address)
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
