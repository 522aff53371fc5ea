"""Runs commands on hostile files in a child process, and says what went wrong. Linux only: it reads /proc.

A case is a folder of files and the arguments of one command, run inside that folder. What must hold: exit code 0 or 2,
no traceback, an end within 20 seconds, at most 2 GB of memory, only lines of photonormal's own on standard error, and
every file of the folder as it was. The child is kept from case to case, since starting costs more than most cases.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import select
import stat
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from fnmatch import fnmatch
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
SECONDS, PEAK_MB = 20, 2000
POLL_SECONDS = 0.2
OWN = re.compile(r"photonormal: [^\x00-\x1f\x7f-\x9f]*")  # a line of ours, without what a terminal would obey


class Driver:
    """A child process that runs cases; use it as a context.

    `runs` names what runs a command, as module:function: it takes its words from `sys.argv` and returns the exit code.
    """

    def __init__(self, runs: str = "photonormal.cli:main") -> None:
        self.runs = runs
        self.child: subprocess.Popen[bytes] | None = None
        self.ends: Counter[str] = Counter()  # how the commands ended
        self.longest_s, self.peak_mb = 0.0, 0.0

    def __enter__(self) -> Driver:
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def faults(self, folder: Path, *arguments: str, writes: Iterable[str] = ()) -> list[str]:
        """What is wrong with how `photonormal ARGUMENTS` behaves inside `folder`; nothing if all is well.

        `writes` are patterns of files in the folder that the command may write where it ends well.
        """
        before = digests(folder)
        found, code = self._run(folder, arguments)
        after = digests(folder)
        written = [n for n in before if code == 0 and any(fnmatch(n, w) for w in writes)]
        lost = [n for n, digest in before.items() if after.get(n) != digest and n not in written]
        found += [f"changed the user's {name!r}" for name in lost]
        self.ends.update(["misbehaved" if found else "refused in one line" if code else "done"])
        return found

    def _run(self, folder: Path, arguments: tuple[str, ...]) -> tuple[list[str], Any]:
        child = self._started()
        Path(f"/proc/{child.pid}/clear_refs").write_text("5")  # the peak counts from here
        assert child.stdin and child.stdout
        child.stdin.write(json.dumps([str(folder), *arguments]).encode() + b"\n")
        child.stdin.flush()
        answer = self._answer(child)
        if answer is None:
            self._end()
            return [f"took more than {SECONDS} s"], None
        if not answer:
            child.communicate()
            self.child = None
            return [f"ended the process: {child.returncode}"], None
        peak_mb = int(Path(f"/proc/{child.pid}/status").read_text().split("VmHWM:")[1].split()[0]) / 1000
        self.peak_mb = max(self.peak_mb, peak_mb)
        code, errors = json.loads(answer)
        found = [] if code in (0, 2) else [f"exit code {code}: {errors[-600:]}"]
        if peak_mb > PEAK_MB:
            found.append(f"took {peak_mb:.0f} MB")
            self._end()
        foreign = [line for line in errors.split("\n")[:-1] if not OWN.fullmatch(line)]
        found += [f"printed {line[:200]!r}" for line in foreign[:3]]
        if code == 2 and len(errors.splitlines()) != 1:
            found.append(f"said why in {len(errors.splitlines())} lines: {errors[:300]!r}")
        return found, code

    def _answer(self, child: subprocess.Popen[bytes]) -> bytes | None:
        """The child's line; None where it takes too long, with what it computes and while it sleeps.

        What it waits for other processes of the machine does not count.
        """
        began, asleep = _processor_s(child.pid), 0.0
        while True:
            waited = time.monotonic()
            ready, _, _ = select.select([child.stdout], [], [], POLL_SECONDS)
            spent = asleep + _processor_s(child.pid) - began
            if ready:
                self.longest_s = max(self.longest_s, spent)
                assert child.stdout
                return child.stdout.readline()
            if _sleeps(child.pid):
                asleep += time.monotonic() - waited
            if spent > SECONDS:
                return None

    def _started(self) -> subprocess.Popen[bytes]:
        if self.child is None:
            command = [sys.executable, "-m", "tests.fuzz.drive", self.runs]
            self.child = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, start_new_session=True
            )
            assert self.child.stdout
            self.child.stdout.readline()  # it is ready
        return self.child

    def _end(self) -> None:
        if self.child is not None:
            self.child.kill()
            self.child.communicate()
            self.child = None


def _status(file: Path) -> list[str]:
    """The fields of a process or a thread from its state on."""
    return file.read_text().rpartition(") ")[2].split()


def _processor_s(process: int) -> float:
    """Seconds that a process has computed."""
    return sum(map(int, _status(Path(f"/proc/{process}/stat"))[11:13])) / os.sysconf("SC_CLK_TCK")


def _sleeps(process: int) -> bool:
    """True where no thread of a process computes or waits for its turn to."""
    try:
        return all(_status(file)[0] != "R" for file in Path(f"/proc/{process}/task").glob("*/stat"))
    except OSError:  # a thread has just ended
        return False


def digests(folder: Path) -> dict[str, str]:
    """What every file and link below a folder holds, by name."""
    found = {}
    for root, _, files in os.walk(folder):
        for name in files:
            path = os.path.join(root, name)
            mode = os.lstat(path).st_mode
            held = os.readlink(path) if stat.S_ISLNK(mode) else str(mode)
            if stat.S_ISREG(mode):
                held = hashlib.sha256(Path(path).read_bytes()).hexdigest()
            found[os.path.relpath(path, folder)] = held
    return found


def serve(runs: str) -> None:
    """The child: run the command of each line, answer with its exit code and what stands on standard error."""
    answers = os.fdopen(os.dup(1), "wb", 0)
    module, name = runs.split(":")
    main = getattr(import_module(module), name)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    answers.write(b"\n")
    for line in sys.stdin.buffer:
        folder, *arguments = json.loads(line)
        os.chdir(folder)
        with tempfile.TemporaryFile() as errors:
            os.dup2(errors.fileno(), 2)
            try:
                sys.argv = ["photonormal", *arguments]
                code = main()
            except SystemExit as leave:
                code = leave.code
            except BaseException as error:
                code = repr(error)
            sys.stdout.flush()
            sys.stderr.flush()
            errors.seek(0)
            said = errors.read().decode("utf-8", "replace")
        answers.write(json.dumps([code, said]).encode() + b"\n")


def campaign(what: str, count: int, faults: Callable[[Driver, int], list[str]], driver: Driver) -> int:
    """Run a module's cases as its options ask: print each that misbehaves, and how many did; the exit code."""
    parser = argparse.ArgumentParser(description=f"Damage {what}, and look at what photonormal makes of them.")
    parser.add_argument("--cases", type=int, default=count)
    parser.add_argument("--seed", type=int, default=0, help="of the first case; the others follow")
    options = parser.parse_args()
    with driver:
        for seed in range(options.seed, options.seed + options.cases):
            for fault in faults(driver, seed):
                print(fault, flush=True)
            if (seed - options.seed + 1) % 100 == 0:
                print(f"after seed {seed}: {dict(driver.ends)}", flush=True)
    ends = ", ".join(f"{n} {end}" for end, n in sorted(driver.ends.items()))
    print(f"{options.cases} {what}: {ends}; longest {driver.longest_s:.1f} s, peak {driver.peak_mb:.0f} MB")
    return 1 if driver.ends["misbehaved"] else 0


if __name__ == "__main__":
    serve(sys.argv[1])
