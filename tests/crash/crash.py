"""Kills commands at random moments and looks at what is left: `make crash`, or python -m tests.crash.crash --kills 100.

For each job and each of SIGKILL, SIGINT and SIGTERM: start the command over what an earlier run left, and send the
signal, half of the times after a random share of the processor time that it takes, half as it is about to change the
disk for a random time: to make, open for writing, rename or remove something. Then no file of the user may have
changed, the old or the new files are whole (after SIGKILL: once the next run has cleared up), there is no traceback,
and the exit code tells the signal. A training goes on until it ends, and must equal one that was never killed to the
bit.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.crash.jobs import JOBS
from tests.crash.run import Ended, Kill, command, load, run

BEGUN_S = 0.005  # by then the command's first lines have been run, which hear of signals
SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)


class Crash:
    """Kills of one job, counted; faults are printed as they are found."""

    def __init__(self, name: str, place: Path, seed: int) -> None:
        self.name, self.job, self.draw = name, JOBS[name](place), random.Random(seed)
        self.states: Counter[str] = Counter()
        self.kills = self.faults = self.cleared = self.late = 0
        self.job.before()
        load(self.job.work)
        self.job.before()
        self.whole = run(self.job.work).well()  # how long it takes where nothing is imported any more

    def kill(self, number: signal.Signals) -> None:
        """One kill, and what is left after it."""
        self.job.before()
        writing = self.kills % 2 == 1
        after_s, at_call = self.draw.uniform(BEGUN_S, self.whole.processor_s), self.draw.randrange(self.whole.calls)
        kill = Kill(number, at_call=at_call) if writing else Kill(number, after_s)
        ended = run(self.job.work, kill)
        self.kills += 1
        self.late += ended.code == 0
        for fault in self.found(number, ended):
            self.faults += 1
            print(f"{self.name}, kill {self.kills}, {kill}: {fault}", flush=True)

    def found(self, number: signal.Signals, ended: Ended) -> list[str]:
        """What is wrong after a kill; what a killed run has left is cleared up."""
        from photonormal.disk import PARTIAL, recover
        from photonormal.types import InputError

        faults = []
        if ended.code not in (0, -number if number == signal.SIGKILL else 128 + number):
            faults.append(f"exit code {ended.code}")
        if "Traceback" in ended.errors or "fault" in ended.errors:
            faults.append(ended.errors)
        left = list(self.job.out.parent.rglob(PARTIAL))
        self.cleared += bool(left)
        if left and number != signal.SIGKILL:
            faults.append(f"left {left}")
        for folder in left:
            try:
                recover(folder.parent)
            except InputError as error:
                faults.append(str(error))
                shutil.rmtree(folder)
        state = self.job.state()
        self.states[state] += 1
        if state not in ("old", "new", "begun"):
            faults.append(f"what is left is {state}")
        lost = [p for p, data in self.job.mine.items() if not p.is_file() or p.read_bytes() != data]
        return faults + [f"{path} has changed" for path in lost]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=100, help="of each signal, for each job")
    parser.add_argument("--jobs", nargs="*", default=list(JOBS), choices=list(JOBS))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    os.environ.pop("PHOTONORMAL_DATA", None)  # a training would validate on it
    load(command("methods"))  # what all jobs need
    rows, faults = [], 0
    for name in given.jobs:
        with tempfile.TemporaryDirectory() as place:
            crash = Crash(name, Path(place), given.seed)
            for k in range(given.kills):
                for number in SIGNALS:
                    crash.kill(number)
                if (k + 1) % 10 == 0:
                    print(f"{name}: {crash.kills} kills, {dict(crash.states)}", flush=True)
        states = ", ".join(f"{n} {state}" for state, n in sorted(crash.states.items()))
        cells = (name, crash.kills, crash.late, states, crash.cleared, crash.faults)
        rows.append("| " + " | ".join(map(str, cells)) + " |")
        faults += crash.faults
    print(
        "| job | kills | ended before | what is left | cleared up by the next run | faults |\n|---|---|---|---|---|---|"
    )
    print("\n".join(rows))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
