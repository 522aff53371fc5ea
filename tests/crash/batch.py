"""Kills a batch by SIGKILL at random moments: python -m tests.crash.batch --kills 40.

A season of captures, one of them broken, of which some are done. Every second kill ends one of the batch's processes:
the batch itself must go on, and end with every capture whole. The others end the batch: then the same command is run
again. After each, the normals are those of a batch that was never killed, to the bit, and the summary tells all.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import psutil

from tests.scenes import lambertian, ring, sphere, write_diligent

CAPTURES = 5
BROKEN = "vase-1"
LEAST_S = 0.1  # before a kill
LONGEST_S = 300


class Season:
    """Captures, and the batch that measures them."""

    def __init__(self, place: Path, seed: int) -> None:
        self.place, self.draw, self.out = place, random.Random(seed), place / "results"
        for k in range(CAPTURES):
            write_diligent(place / "season" / f"vase-{k}", lambertian(sphere(40 + 8 * k), ring(7, 60)))
        picture = place / "season" / BROKEN / "003.png"
        picture.write_bytes(picture.read_bytes()[:99])
        start = time.monotonic()
        assert self.start().wait(LONGEST_S) == 1
        self.takes_s = time.monotonic() - start
        self.whole = self.state()
        assert len(self.whole) == CAPTURES - 1
        self.states: Counter[str] = Counter()

    def start(self) -> subprocess.Popen[bytes]:
        """The command, begun."""
        words = [
            "batch",
            str(self.place / "season" / "*"),
            "--out",
            str(self.out),
            "--method",
            "woodham",
            "--jobs",
            "2",
        ]
        code = "import sys; from photonormal_command import main; sys.exit(main())"
        return subprocess.Popen(
            [sys.executable, "-c", code, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ
        )

    def state(self) -> dict[str, str]:
        """Digests of the normals of every capture that has some."""
        found = {}
        for path in sorted(self.out.glob("*/normals.npz")):
            with np.load(path) as file:
                found[path.parent.name] = hashlib.sha256(file["normals"].tobytes()).hexdigest()
        return found

    def kill(self, one_process: bool) -> list[str]:
        """One kill, and what is wrong once the command has been run to its end."""
        for name in self.draw.sample(sorted(self.whole), self.draw.randint(1, len(self.whole))):
            shutil.rmtree(self.out / name)
        batch = self.start()
        time.sleep(self.draw.uniform(LEAST_S, self.takes_s))
        if one_process:
            workers = [p for p in psutil.Process(batch.pid).children() if batch.poll() is None and _measures(p)]
            self.states["one process killed" if workers else "no process there"] += 1
            for worker in self.draw.sample(workers, min(1, len(workers))):
                worker.kill()
        else:
            batch.kill()
            batch.wait()
            left = self.state()
            self.states[f"{len(left)} of {len(self.whole)} captures done"] += 1
            if wrong := [name for name, digest in left.items() if digest != self.whole[name]]:
                return [f"{wrong} are other normals after the kill"]
            batch = self.start()
        return self.wrong(batch.wait(LONGEST_S))

    def wrong(self, code: int) -> list[str]:
        """What is not as a batch that was never killed leaves it."""
        faults = [] if code == 1 else [f"code {code}"]
        if self.state() != self.whole:
            faults.append(f"normals are {sorted(self.state())}, or others")
        with (self.out / "summary.csv").open(encoding="utf-8-sig", newline="") as file:
            told = {row["capture"]: row["state"] for row in csv.DictReader(file)}
        if told != dict.fromkeys(self.whole, "done") | {BROKEN: "failed"}:
            faults.append(f"the summary tells {told}")
        if left := [str(p) for p in self.out.rglob(".photonormal-partial")]:
            faults.append(f"left {left}")
        return faults


def _measures(process: psutil.Process) -> bool:
    try:
        return any("spawn_main" in word for word in process.cmdline())
    except psutil.Error:
        return False


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
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
