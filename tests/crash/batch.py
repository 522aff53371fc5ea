"""Kills a batch by SIGKILL at random moments: python -m tests.crash.batch --kills 40.

A season of captures, one of them broken, of which some are done. A kill comes a moment after the batch has said that a
capture is begun. Every second one ends the process that measures it: the batch itself must go on, and end with every
capture whole. The others end the batch: then the same command is run again. After each, the normals are those of a
batch that was never killed, to the bit, and the summary tells all.
"""

from __future__ import annotations

import argparse
import csv
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
from contextlib import suppress
from pathlib import Path

import numpy as np

from tests.scenes import lambertian, ring, sphere, write_diligent

CAPTURES = 5
BROKEN = "vase-1"
AFTER_S = 0.3  # at most, from the begin of a capture to a kill
LONGEST_S = 300


class Season:
    """Captures, and the batch that measures them."""

    def __init__(self, place: Path, seed: int) -> None:
        self.place, self.draw, self.out = place, random.Random(seed), place / "results"
        for k in range(CAPTURES):
            write_diligent(place / "season" / f"vase-{k}", lambertian(sphere(40 + 8 * k), ring(7, 60)))
        picture = place / "season" / BROKEN / "003.png"
        picture.write_bytes(picture.read_bytes()[:99])
        assert ended(self.start()) == 1
        self.whole = self.state()
        assert len(self.whole) == CAPTURES - 1
        self.states: Counter[str] = Counter()

    def start(self) -> subprocess.Popen[bytes]:
        """The command, begun."""
        return start(self.place, self.out)

    def state(self) -> dict[str, str]:
        """Digests of the normals of every capture that has some."""
        return digests(self.out)

    def kill(self, one_process: bool) -> list[str]:
        """One kill, and what is wrong once the command has been run to its end."""
        missing = self.draw.sample(sorted(self.whole), self.draw.randint(1, len(self.whole)))
        for name in missing:
            shutil.rmtree(self.out / name)
        batch = self.start()
        process = begun(batch, self.draw.randint(1, len(missing)))
        time.sleep(self.draw.uniform(0, AFTER_S))
        if one_process:
            with suppress(ProcessLookupError):  # it has ended by itself
                os.kill(process, signal.SIGKILL)
                self.states["one process killed"] += 1
        else:
            batch.kill()
            ended(batch)
            left = self.state()
            self.states[f"{len(left)} of {len(self.whole)} captures done"] += 1
            if wrong := [name for name, digest in left.items() if digest != self.whole[name]]:
                return [f"{wrong} are other normals after the kill"]
            batch = self.start()
        return self.wrong(ended(batch))

    def wrong(self, code: int) -> list[str]:
        """What is not as a batch that was never killed leaves it."""
        faults = [] if code == 1 else [f"code {code}"]
        if self.state() != self.whole:
            faults.append(f"normals are {sorted(self.state())}, or others")
        told = states(self.out)
        if told != dict.fromkeys(self.whole, "done") | {BROKEN: "failed"}:
            faults.append(f"the summary tells {told}")
        if left := [str(p) for p in self.out.rglob(".photonormal-partial")]:
            faults.append(f"left {left}")
        return faults


def start(place: Path, out: Path, *words: str) -> subprocess.Popen[bytes]:
    """The command over the season that lies in `place`, begun."""
    given = ["batch", str(place / "season" / "*"), "--out", str(out), "--method", "woodham", "--json-lines", *words]
    given += [] if words else ["--jobs", "2"]
    code = "import sys; from photonormal_command import main; sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, "-c", code, *given], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=os.environ
    )


def digests(out: Path) -> dict[str, str]:
    """Digests of the normals of every capture that has some."""
    found = {}
    for path in sorted(out.glob("*/normals.npz")):
        with np.load(path) as file:
            found[path.parent.name] = hashlib.sha256(file["normals"].tobytes()).hexdigest()
    return found


def states(out: Path) -> dict[str, str]:
    """What the summary tells of each capture."""
    with (out / "summary.csv").open(encoding="utf-8-sig", newline="") as file:
        return {row["capture"]: row["state"] for row in csv.DictReader(file)}


def begun(batch: subprocess.Popen[bytes], count: int) -> int:
    """The process that measures the capture that a batch begins as its `count`-th."""
    assert batch.stdout is not None
    for line in batch.stdout:
        event = json.loads(line)
        count -= event["event"] == "begun"
        if not count:
            return int(event["where"].split()[-1])
    raise AssertionError("the batch ended before it began what was missing")


def ended(batch: subprocess.Popen[bytes]) -> int:
    """The code that a batch ends with."""
    batch.communicate(timeout=LONGEST_S)
    return batch.returncode


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        season, faults = Season(Path(place), given.seed), 0
        for k in range(given.kills):
            for fault in season.kill(one_process=k % 2 == 1):
                faults += 1
                print(f"kill {k + 1}: {fault}", flush=True)
            if (k + 1) % 4 == 0:
                print(f"{k + 1} kills, {faults} faults so far: {dict(season.states)}", flush=True)
        print(f"{given.kills} kills, {faults} faults; after them: {dict(season.states)}")
    hit = given.kills < 2 or season.states["one process killed"]
    return 1 if faults or not hit else 0


if __name__ == "__main__":
    sys.exit(main())
