"""A season whose batch is killed: python -m tests.crash.season [--captures 300 --broken 10 --kills 2] [--workers 3].

Captures, some of them with a photograph that is cut short. The batch is ended by SIGKILL at random moments and the same
command run again, until it ends by itself. With `--workers` a Dask scheduler and so many workers, programs of their
own, measure, and it is one of the workers that is ended for good, while it measures. In the end every capture must
have the normals that a measurement in this process finds, to the bit, the summary must tell all of them, and nothing
must have been measured twice but what was at work when a kill came.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import photonormal as pn
from tests.crash.batch import LONGEST_S, digests, start, states
from tests.scenes import lambertian, ring, sphere, write_diligent

SMALLEST, SIZES = 24, 24  # pixels of a side, and how many sizes
LIGHTS = 6


def write(place: Path, captures: int, broken: set[int]) -> None:
    """The season: as many different captures as there are sizes, again and again."""
    for k in range(captures):
        folder = place / "season" / f"vase-{k}"
        if k < SIZES:
            write_diligent(folder, lambertian(sphere(SMALLEST + k), ring(LIGHTS, 60)))
        else:
            shutil.copytree(place / "season" / f"vase-{k % SIZES}", folder)
    for k in broken:
        picture = place / "season" / f"vase-{k}" / "003.png"
        picture.write_bytes(picture.read_bytes()[:99])


def killed_after(batch: subprocess.Popen[bytes], count: int | None, measured: Counter[str]) -> int:
    """Count the captures that a batch measures, and end it once it has measured so many; None: it ends by itself.
    Returns how many it has told of."""
    assert batch.stdout is not None
    told = 0
    for line in batch.stdout:
        event = json.loads(line)
        if event["event"] == "done":
            told += 1
            measured[event["capture"]] += 1
        if told == count:
            batch.kill()
            count = -1
    batch.wait(LONGEST_S)
    return told


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, dict[str, subprocess.Popen[bytes]]]]:
    """A scheduler's address, and its workers by their addresses; each a program of its own, without a nanny."""
    from distributed import Client

    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    with tempfile.TemporaryDirectory() as place:
        told = Path(place) / "scheduler.json"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        programs = [subprocess.Popen([*dask, "--no-dashboard", "--scheduler-file", str(told)], **quiet)]
        try:
            while not told.exists():
                time.sleep(0.1)
            address = json.loads(told.read_text())["address"]
            worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
            for k in range(workers):
                programs.append(subprocess.Popen([*worker, "--no-dashboard", "--name", str(k)], **quiet))
            with Client(address) as client:
                client.wait_for_workers(workers)
                there = client.scheduler_info()["workers"]
            yield address, {where: programs[1 + int(about["name"])] for where, about in there.items()}
        finally:
            for program in programs:
                program.kill()
                program.wait()


def faults(place: Path, out: Path, captures: int, broken: set[int], measured: Counter[str], at_work: int) -> list[str]:
    """What is not as it must be, in words."""
    found = []
    whole = {f"vase-{k}" for k in range(captures) if k not in broken}
    if states(out) != dict.fromkeys(whole, "done") | {f"vase-{k}": "failed" for k in broken}:
        found.append(f"the summary tells {Counter(states(out).values())}")
    normals = digests(out)
    expected: dict[int, str] = {}  # by the size
    for k in sorted(set(range(captures)) - broken):
        if k % SIZES not in expected:
            solved = pn.solve(pn.load(place / "season" / f"vase-{k}"), "woodham").map
            expected[k % SIZES] = hashlib.sha256(solved.tobytes()).hexdigest()
        if normals.get(f"vase-{k}") != expected[k % SIZES]:
            found.append(f"vase-{k} has other normals")
    if (twice := sum(measured.values()) - len(whole)) > at_work:
        found.append(f"{twice} captures were measured twice")
    if left := [str(p) for p in out.rglob(".photonormal-partial")]:
        found.append(f"left {left}")
    return found


def on_one_machine(place: Path, out: Path, captures: int, kills: int, draw: random.Random) -> Counter[str]:
    """Run the batch, killed so many times, to its end; gives how often each capture was measured."""
    measured: Counter[str] = Counter()
    for k in range(kills + 1):
        begun, count = time.monotonic(), draw.randint(1, captures // (kills + 1)) if k < kills else None
        told = killed_after(start(place, out), count, measured)
        ended = "ended by itself" if count is None else f"killed, {len(digests(out))} results are there"
        print(f"run {k + 1}: {told} measured in {time.monotonic() - begun:.1f} s, {ended}", flush=True)
    return measured


def on_a_cluster(place: Path, out: Path, captures: int, workers: int, draw: random.Random) -> Counter[str]:
    """Run the batch on workers of which one is killed while it measures; gives how often each capture was measured."""
    measured: Counter[str] = Counter()
    with cluster(workers) as (address, programs):
        batch, left, where = start(place, out, "--scheduler", address), draw.randint(1, captures // 2), Counter()
        assert batch.stdout is not None
        begun = time.monotonic()
        for line in batch.stdout:
            event = json.loads(line)
            if event["event"] == "begun":
                where[event["where"]] += 1
                left -= 1
                if not left:
                    os.kill(programs[event["where"]].pid, signal.SIGKILL)
                    print(f"{event['where']} killed after {sum(where.values())} captures begun", flush=True)
            elif event["event"] == "done":
                measured[event["capture"]] += 1
        batch.wait(LONGEST_S)
        print(f"{sum(measured.values())} measured in {time.monotonic() - begun:.1f} s, begun by {dict(where)}")
    return measured


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=300)
    parser.add_argument("--broken", type=int, default=10)
    parser.add_argument("--kills", type=int, default=2)
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="where the results stay; else they go")
    given = parser.parse_args()
    draw = random.Random(given.seed)
    broken = set(draw.sample(range(given.captures), given.broken))
    with tempfile.TemporaryDirectory() as place:
        folder, out = Path(place), given.out or Path(place) / "results"
        write(folder, given.captures, broken)
        if given.workers:
            measured = on_a_cluster(folder, out, given.captures, given.workers, draw)
        else:
            measured = on_one_machine(folder, out, given.captures, given.kills, draw)
        found = faults(folder, out, given.captures, broken, measured, 2 * given.kills)
    print(f"{given.captures} captures, {given.broken} of them broken: {len(found)} faults", *found, sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
