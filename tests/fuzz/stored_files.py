"""Stored files changed at random, and what photonormal makes of them.

    python -m tests.fuzz.stored_files --count 2000 --seed 0

Result folders for `score` and `integrate`, runs folders for `table`, `report` and `figure`, weights for `measure`,
checkpoints to resume from, and files of options. Each case is one file changed; a command reads it. It must end with
its results or with one line, within SECONDS and MEMORY_MB, and leave every file as it was.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.fuzz.change import changed

SECONDS, MEMORY_MB = 20, 2048
KINDS = {  # kind of file -> commands that read it
    "runs": (
        *("table RUNS", "table RUNS --json", "report RUNS --out OUT/r.html --no-surfaces"),
        *("figure errors RUNS --out OUT", "figure images RUNS --out OUT"),
    ),
    "journal": ("figure convergence TRAINING --out OUT",),
    "result": ("score CAPTURE RESULT", "integrate RESULT --out OUT/m.ply", "convert RESULT --out OUT/n.png"),
    "weights": ("measure CAPTURE --out OUT/r --no-mesh --method lambertian-prior:weights=WEIGHTS",),
    "checkpoint": ("resume TRAINING",),
    "options": ("bench diligent ROOT --out OUT/runs --methods woodham --objects ball --fixed FIXED",),
}  # fmt: skip


def originals(folder: Path) -> dict[str, Path]:
    """Sound files of every kind, and what they are read with."""
    from photonormal.bench import bench
    from photonormal.cli.measuring import Measure
    from photonormal.train.loop import train
    from tests.scenes import lambertian, ring, sphere, write_diligent
    from tests.train.toy import Toy

    root, capture = folder / "root", folder / "root" / "pmsData" / "ballPNG"
    write_diligent(capture, lambertian(sphere(24), ring(7, 70)))
    bench("diligent", root, folder / "runs", methods="woodham", images="all,6", draws=1)
    Measure(capture, folder / "result", method="woodham", mesh=False)()
    train(tiny(), folder / "training", device="cpu", stream=Toy, precision="float32")
    (folder / "fixed.txt").write_text("ball: 1-5\n# the others\n1-6\n")
    places = {"ROOT": root, "CAPTURE": capture, "RUNS": folder / "runs", "RESULT": folder / "result"}
    weights = folder / "training" / "lambertian-prior.safetensors"
    return places | {"TRAINING": folder / "training", "WEIGHTS": weights, "FIXED": folder / "fixed.txt"}


def tiny() -> Any:
    """A recipe of one step."""
    from photonormal.train.recipes import Recipe

    return Recipe(config={"width": 8}, images=(3, 5), batch=4, steps=1, warmup=1, clip=1.0, ema=0.9, validate=9)


def files_of(kind: str, places: dict[str, Path]) -> list[Path]:
    """The files of a kind that a case may change."""
    training, result = places["TRAINING"], places["RESULT"]
    return {
        "runs": sorted(p for p in places["RUNS"].rglob("*") if p.is_file()),
        "result": [result / "normals.npz", result / "report.json"],
        "journal": [training / "journal.jsonl"],
        "checkpoint": [training / "checkpoint.pt"],
        "weights": [places["WEIGHTS"]],
        "options": [places["FIXED"]],
    }[kind]


def outcome(command: str, places: dict[str, Path]) -> str:
    """What a command does: "done", "refused", or what is wrong with it."""
    said, start = io.StringIO(), time.monotonic()
    words = [re.sub("|".join(places), lambda m: str(places[m[0]]), word) for word in command.split()]
    signal.alarm(SECONDS)
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = run(words)
    except Slow:
        return f"longer than {SECONDS} s"
    except BaseException:
        return "traceback: " + " / ".join(traceback.format_exc().splitlines()[-3:])
    finally:
        signal.alarm(0)
    lines = said.getvalue().splitlines()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if time.monotonic() - start > SECONDS or memory > MEMORY_MB:
        return f"{time.monotonic() - start:.0f} s, {memory:.0f} MB"
    if "fault of photonormal" in said.getvalue():
        return lines[-1]
    if code == 2 and len(lines) == 1 and lines[0].startswith("photonormal: ") and lines[0].isprintable():
        return "refused"
    said_something = [line for line in lines if not line.startswith("photonormal: ")]
    return "done" if code in (0, 1) and not said_something else f"exit code {code}: {lines[:3]}"


def run(words: list[str]) -> int:
    """One command line; `resume` goes on with the tiny training."""
    from photonormal.cli import main
    from photonormal.train.loop import train
    from photonormal.types import InputError
    from tests.train.toy import Toy

    if words[0] != "resume":
        return main(words)
    try:
        train(tiny(), words[1], device="cpu", stream=Toy, resume=True)
        return 0
    except InputError as error:
        print(f"photonormal: {error}", file=sys.stderr)
        return 2


class Slow(BaseException):
    """A case takes too long."""


def stop(*_: Any) -> None:
    raise Slow


def digests(folder: Path) -> dict[str, str]:
    """What every regular file of a folder holds."""
    files = (p for p in sorted(folder.rglob("*")) if p.is_file() and not p.is_symlink())
    return {str(p): hashlib.sha256(p.read_bytes()).hexdigest() for p in files if p.name != "scores.json"}


def fuzz(count: int, seed: int, tell: Callable[[str], None]) -> Counter[str]:
    """`count` cases; how many ended in which way. `tell` is told of what is wrong."""
    from photonormal.train import validate

    validate.BATCHES = 1
    signal.signal(signal.SIGALRM, stop)
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as temporary:
        sound = originals(Path(temporary) / "sound")
        base = Path(temporary) / "sound"
        for i in range(count):
            draw = random.Random(f"{seed} {i}")
            kind = list(KINDS)[i % len(KINDS)]
            work = Path(temporary) / "case"
            shutil.copytree(base, work)
            places = {k: work / p.relative_to(base) for k, p in sound.items()} | {"OUT": work / "out"}
            (work / "out").mkdir()
            target = draw.choice(files_of(kind, places))
            how = changed(target, draw)
            before = digests(work)
            command = draw.choice(KINDS[kind])
            ended = outcome(command, places)
            after = digests(work)
            lost = [p for p, digest in before.items() if after.get(p) != digest]
            if command.startswith("resume") and ended == "done":
                lost = [p for p in lost if not p.startswith(str(places["TRAINING"]))]
            if lost and ended in ("done", "refused"):
                ended = f"changed {lost[0]}"
            found[ended if ended in ("done", "refused") else "wrong"] += 1
            if ended not in ("done", "refused"):
                tell(f"case {i}: {command}, {target.name} {how}: {ended}")
            shutil.rmtree(work)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    ends = fuzz(given.count, given.seed, lambda line: print(line, flush=True))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{given.count} cases: {dict(ends)}; peak memory {peak:.0f} MB")
    sys.exit(bool(ends["wrong"]))
