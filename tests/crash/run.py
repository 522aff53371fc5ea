"""Commands that run in a process of their own, forked from one that has loaded everything, and are killed there.

Loading takes seconds, a command here a tenth of one: 1,800 kills need a parent that has torch in memory. What a signal
does while photonormal is still loading is tested in tests/cli. Linux only: it reads other processes' clocks.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from mmap import mmap
from typing import Any

CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate", "os.chmod", "shutil.rmtree"}
LONGEST_S = 600
CORES = os.cpu_count() or 1
Work = Callable[[], int]  # what a process does; returns its exit code


def command(*words: object) -> Work:
    """The command line `photonormal WORDS`, with its first lines."""

    def work() -> int:
        import photonormal_command

        sys.argv = ["photonormal", *map(str, words)]
        return photonormal_command.main()

    return work


@dataclass
class Ended:
    """How a process has ended: its exit code, minus the signal where one ended it."""

    code: int
    errors: str
    processor_s: float
    calls: int  # that change the disk

    def well(self) -> Ended:
        assert self.code == 0, self.errors
        return self


@dataclass(frozen=True)
class Kill:
    """A signal, either when the process has computed for some time, or as it is about to change the disk once more."""

    number: signal.Signals
    after_s: float = float("inf")
    at_call: int = -1


def run(work: Work, kill: Kill | None = None) -> Ended:
    """Fork a process that does the work, and send it a signal on its way."""
    calls = mmap(-1, 8)  # shared
    with tempfile.TemporaryFile() as errors:
        sys.stdout.flush()
        sys.stderr.flush()
        process = os.fork()
        if process == 0:
            _child(work, errors.fileno(), calls, kill)
        began = time.monotonic()
        clock = (~process << 3) | 2  # Linux's name of a process's processor clock
        computed_s = 0.0
        while True:
            ended, status, _ = os.wait4(process, os.WNOHANG)
            if ended:
                break
            with contextlib.suppress(OSError):  # it ends just now
                computed_s = time.clock_gettime(clock)
            if kill and computed_s >= kill.after_s:
                os.kill(process, kill.number)
                kill = None
            if time.monotonic() - began > LONGEST_S:
                os.kill(process, signal.SIGKILL)
            to_wait_s = kill.after_s - computed_s if kill else LONGEST_S
            time.sleep(min(max(to_wait_s / CORES, 0.0005), 0.02))
        errors.seek(0)
        said = errors.read().decode("utf-8", "replace")
    code = os.waitstatus_to_exitcode(status)
    return Ended(code, said, computed_s, int.from_bytes(calls[:8], "little"))


def _child(work: Work, errors: int, calls: mmap, kill: Kill | None) -> None:
    """Never returns."""
    code = 1
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(errors, 2)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        sys.addaudithook(_counted(calls, kill))
        code = work()
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        sys.excepthook(*sys.exc_info())  # type: ignore[arg-type]
    finally:
        os._exit(code)


def _counted(calls: mmap, kill: Kill | None) -> Callable[[str, Any], None]:
    """Counts the calls that change the disk; before one of them sends the signal."""
    one_at_a_time = threading.Lock()

    def hook(event: str, told: Any) -> None:
        if event in CHANGES or (event == "open" and told[2] is not None and told[2] & (os.O_WRONLY | os.O_RDWR)):
            with one_at_a_time:
                count = int.from_bytes(calls[:8], "little")
                calls[:8] = (count + 1).to_bytes(8, "little")
            if kill and count == kill.at_call:
                os.kill(os.getpid(), kill.number)

    return hook


def load(work: Work) -> None:
    """Import here whatever a process imports while it does the work."""
    with tempfile.NamedTemporaryFile() as names:

        def noted() -> int:
            code = work()
            names.write("\n".join(sys.modules).encode())
            names.flush()
            return code

        run(noted).well()
        names.seek(0)  # where the process wrote
        for name in names.read().decode().split("\n"):
            with contextlib.suppress(Exception):
                importlib.import_module(name)
    logging.disable()  # tests call what tells of kills, too
