"""Kills commands at random moments and looks at what is left: `make crash`, or python -m tests.crash.crash --kills 100.

For each job and each of SIGKILL, SIGINT and SIGTERM: start the command over what an earlier run left, kill it after
a random share of its running time, and check that no file of the user has changed, that the old or the new result is
whole (after SIGKILL: once the next run has cleared up), that there is no traceback, and that the exit code tells
the signal. A training is resumed until it ends, and must equal one that was never killed to the bit.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from photonormal.disk import PARTIAL, recover
from tests.calibrate.chrome import dome, write_chrome, write_pictures
from tests.scenes import lambertian, ring, sphere, write_diligent

COMMAND = [sys.executable, "-c", "import sys; from photonormal_command import main; sys.exit(main())"]
SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)
MINE = 2000  # files of the user's in the folder of a result


@dataclass
class Job:
    """A command that writes into `out`; `before` makes what is there at its start, `whole` tells a state's name."""

    name: str
    out: Path
    command: list[str]
    before: Callable[[], None]
    whole: Callable[[], str]
    mine: dict[Path, bytes] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    states: dict[str, int] = field(default_factory=dict)
    partial: int = 0  # kills that left something for the next run

    def start(self) -> subprocess.Popen:
        return subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

    def kill(self, number: int, seconds: float) -> None:
        """One kill, and what is left of it."""
        self.before()
        run = self.start()
        time.sleep(seconds)
        alive = run.poll() is None
        run.send_signal(number)
        _, err = run.communicate(timeout=120)
        expected = -number if number == signal.SIGKILL else 128 + number
        self.expect(not alive or run.returncode in (expected, 0, -number * (seconds < 0.1)), f"code {run.returncode}")
        self.expect("Traceback" not in err and "fault" not in err, err)
        left = list(self.out.rglob(PARTIAL)) if self.out.exists() else []
        self.partial += bool(left)
        self.expect(not left or number == signal.SIGKILL, f"left {left}")
        for folder in left:
            recover(folder.parent)
        state = self.whole()
        self.states[state] = self.states.get(state, 0) + 1
        self.expect(state in ("old", "new", "begun"), f"state {state} after {signal.Signals(number).name}")
        for path, data in self.mine.items():
            self.expect(path.is_file() and path.read_bytes() == data, f"{path} has changed")

    def expect(self, fact: bool, otherwise: str) -> None:
        if not fact:
            self.faults.append(otherwise)

    def place_mine(self, folder: Path, count: int = MINE) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for i in range(count):
            path = folder / f"mine-{i}.txt"
            path.write_text(f"mine {i}")
            self.mine[path] = path.read_bytes()


def snapshot(folder: Path) -> dict[str, bytes]:
    """Digests of the files of a folder, but for the user's and for reports, whose seconds differ."""
    names = [p for p in sorted(folder.rglob("*")) if p.is_file() and not p.name.startswith("mine-")]
    return {str(p.relative_to(folder)): _digest(p) for p in names}


def _digest(path: Path) -> bytes:
    if path.name == "report.json" or path.suffix == ".json":
        return b"json"  # told by its name only: it holds seconds
    if path.suffix == ".npz":
        with np.load(path) as file:
            return hashlib.sha256(b"".join(file[k].tobytes() for k in sorted(file.files))).digest()
    return hashlib.sha256(path.read_bytes()).digest()


def again(job: Job, old: Callable[[], None]) -> Job:
    """A job over a result: learns what the old and the new one look like, and makes the old one before each kill."""
    old()
    was = snapshot(job.out)
    run = job.start()
    _, err = run.communicate()
    assert run.returncode == 0, err
    new = snapshot(job.out)
    assert was != new
    job.before = lambda: None if snapshot(job.out) == was else old()
    job.whole = lambda: {str(was): "old", str(new): "new"}.get(str(snapshot(job.out)), "broken")
    return job


def call(*words: object) -> None:
    subprocess.run([*COMMAND, *map(str, words)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def measure(place: Path) -> Job:
    for name, n in (("a", 8), ("b", 11)):
        write_diligent(place / name, lambertian(sphere(40), ring(n, 60)))
    out = place / "result"
    words = ["--out", str(out), "--method", "woodham", "--overwrite"]
    job = Job("measure", out, [*COMMAND, "measure", str(place / "b"), *words, "--no-mesh"], lambda: None, str)
    job.place_mine(out)
    return again(job, lambda: call("measure", place / "a", *words))


def calibrate(place: Path) -> Job:
    write_pictures(place / "object", np.full((9, 30, 40), 90, np.uint8), name="{:03d}.png")
    write_chrome(place / "one", dome(9))
    write_chrome(place / "two", dome(9, 40.0))
    out = place / "rig"
    words = ["calibrate", str(place / "object"), "--out", str(out / "lights.lp"), "--overwrite", "--sphere"]
    job = Job("calibrate", out, [*COMMAND, *words, str(place / "two")], lambda: None, str)
    job.place_mine(out, 100)
    return again(job, lambda: call(*words, place / "one"))


def bench(place: Path) -> Job:
    for k, name in enumerate(("ball", "bear", "cat")):
        write_diligent(place / "root" / "pmsData" / f"{name}PNG", lambertian(sphere(24), ring(6 + k, 60)))
    out = place / "runs"
    words = ["bench", "diligent", str(place / "root"), "--methods", "woodham,l1", "--out"]
    call(*words, place / "whole")
    whole = {k: v for k, v in snapshot(place / "whole").items()}

    def state() -> str:
        """Every prediction that is there is one of the undisturbed run, and has its record."""
        found = snapshot(out) if out.exists() else {}
        right = all(whole.get(name) == digest for name, digest in found.items())
        paired = all(name.removesuffix(".npz") + ".json" in found for name in found if "truth" not in name)
        return "new" if found == whole else "begun" if right and paired else "broken"

    def before() -> None:
        for path in sorted(out.rglob("*"), reverse=True) if out.exists() else []:
            if not path.name.startswith("mine-"):
                path.rmdir() if path.is_dir() else path.unlink()

    job = Job("bench", out, [*COMMAND, *words, str(out)], before, state)
    job.place_mine(out, 100)
    return job


def render(place: Path) -> Job:
    out = place / "made" / "set"
    words = ["render", "lambert", "--count", "2", "--out"]
    call(*words, place / "whole")
    whole = {k: v for k, v in snapshot(place / "whole").items() if not k.endswith(".mat")}  # whose header has the time

    def state() -> str:
        found = {k: v for k, v in snapshot(out).items() if not k.endswith(".mat")} if out.exists() else {}
        return "new" if found == whole else "old" if not found else "broken"

    def before() -> None:
        for path in sorted(out.rglob("*"), reverse=True) if out.exists() else []:
            path.rmdir() if path.is_dir() else path.unlink()

    job = Job("render", out, [*COMMAND, *words, str(out)], before, state)
    job.place_mine(place / "made", 100)
    return job


TRAINING = """
import sys
sys.argv = ["photonormal", *sys.argv[1:]]
from photonormal import cli
import photonormal_command
def work(interrupted):
    from pathlib import Path
    import photonormal.train.validate as validate
    from photonormal.train import checkpoint, loop
    from photonormal.train.recipes import Recipe
    from tests.train.toy import Toy
    validate.BATCHES = 1
    recipe = Recipe(config={"width": 8}, images=(3, 5), batch=4, steps=60, warmup=4, clip=1.0, ema=0.9, reuse=2,
                    ring=3, validate=30)
    out = Path(sys.argv[1])
    try:
        loop.train(recipe, out, device="cpu", stream=Toy, save_seconds=0, resume=(out / checkpoint.NAME).exists())
    except KeyboardInterrupt:
        return 130
    return 0
cli.main = work
sys.exit(photonormal_command.main())
"""


def train(place: Path) -> Job:
    out = place / "training"
    command = [sys.executable, "-c", TRAINING]
    environment = {k: v for k, v in os.environ.items() if k != "PHOTONORMAL_DATA"}
    os.environ.clear()
    os.environ.update(environment)
    subprocess.run([*command, str(place / "whole")], check=True, stderr=subprocess.DEVNULL)
    weights = (place / "whole" / "lambertian-prior.safetensors").name

    def numbers(folder: Path) -> str:
        import torch

        state = torch.load(folder / "checkpoint.pt", weights_only=True)
        return "".join(_sha(state[part]) for part in ("network", "mean")) + str(state["step"])

    whole = numbers(place / "whole")

    def state() -> str:
        if not (out / "checkpoint.pt").is_file():
            return "begun"
        told = numbers(out)
        return "begun" if not told.endswith("60") else "new" if told == whole else "broken"

    def before() -> None:
        """A training that is done begins anew; another one goes on."""
        if (out / weights).is_file():
            for path in sorted(out.rglob("*"), reverse=True):
                if not path.name.startswith("mine-"):
                    path.rmdir() if path.is_dir() else path.unlink()

    job = Job("train", out, [*command, str(out)], before, state)
    job.place_mine(out, 100)
    return job


def _sha(tensors: dict) -> str:
    return hashlib.sha256(b"".join(tensors[k].numpy().tobytes() for k in sorted(tensors))).hexdigest()


JOBS = {job.__name__: job for job in (measure, calibrate, bench, train, render)}


def crash(name: str, kills: int, seed: int, place: Path) -> Job:
    """`kills` kills of each signal."""
    job = JOBS[name](place)
    job.before()
    start = time.monotonic()
    job.start().communicate()
    length = time.monotonic() - start
    g = random.Random(seed)
    for _ in range(kills):
        for number in SIGNALS:
            job.kill(number, g.uniform(0, 1.05 * length))
    return job


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="of each signal, for each job")
    parser.add_argument("--jobs", nargs="*", default=list(JOBS), choices=list(JOBS))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    faults = 0
    print("| job | kills | states after them | left for the next run | faults |\n|---|---|---|---|---|")
    for name in given.jobs:
        with tempfile.TemporaryDirectory() as place:
            job = crash(name, given.kills, given.seed, Path(place))
        states = ", ".join(f"{n} {state}" for state, n in sorted(job.states.items()))
        print(f"| {name} | {3 * given.kills} | {states} | {job.partial} | {len(job.faults)} |", flush=True)
        for fault in job.faults[:20]:
            print(f"    {fault}", file=sys.stderr)
        faults += len(job.faults)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
