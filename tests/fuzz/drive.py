"""Runs commands on hostile files in a child process, and says what went wrong. Linux only: it reads /proc.

A case is a folder of files and the arguments of one command, run inside that folder. What must hold: exit code 0 or 2,
no traceback, an end within 20 seconds, at most 2 GB of memory, only lines of photonormal's own on standard error, and
every file of the folder as it was. The child is kept from case to case, since starting costs more than most cases.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import stat
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

SECONDS, PEAK_MB = 20, 2000
OWN = re.compile(r"photonormal: [^\x00-\x1f\x7f-\x9f]*")  # a line of ours, without what a terminal would obey


class Driver:
    """A child process that runs cases; use it as a context."""

    def __enter__(self) -> Driver:
        self.child: subprocess.Popen[bytes] | None = None
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def faults(self, folder: Path, *arguments: str) -> list[str]:
        """What is wrong with how `photonormal ARGUMENTS` behaves inside `folder`; nothing if all is well."""
        before = digests(folder)
        found = self._run(folder, arguments)
        after = digests(folder)
        return found + [f"changed the user's {name!r}" for name, digest in before.items() if after.get(name) != digest]

    def _run(self, folder: Path, arguments: tuple[str, ...]) -> list[str]:
        child = self._started()
        Path(f"/proc/{child.pid}/clear_refs").write_text("5")  # the peak counts from here
        timer = threading.Timer(SECONDS, lambda: os.kill(child.pid, signal.SIGKILL))
        timer.start()
        assert child.stdin and child.stdout
        child.stdin.write(json.dumps([str(folder), *arguments]).encode() + b"\n")
        child.stdin.flush()
        answer = child.stdout.readline()
        timer.cancel()
        if not answer:
            child.communicate()
            self.child, code = None, child.returncode
            return [f"took more than {SECONDS} s" if code == -signal.SIGKILL else f"ended the process: {code}"]
        peak_mb = int(Path(f"/proc/{child.pid}/status").read_text().split("VmHWM:")[1].split()[0]) / 1000
        code, errors = json.loads(answer)
        found = [] if code in (0, 2) else [f"exit code {code}: {errors[-600:]}"]
        if peak_mb > PEAK_MB:
            found.append(f"took {peak_mb:.0f} MB")
            self._end()
        foreign = [line for line in errors.split("\n")[:-1] if not OWN.fullmatch(line)]
        found += [f"printed {line[:200]!r}" for line in foreign[:3]]
        if code == 2 and len(errors.splitlines()) != 1:
            found.append(f"said why in {len(errors.splitlines())} lines: {errors[:300]!r}")
        return found

    def _started(self) -> subprocess.Popen[bytes]:
        if self.child is None:
            self.child = subprocess.Popen(
                [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
            assert self.child.stdout
            self.child.stdout.readline()  # it is ready
        return self.child

    def _end(self) -> None:
        if self.child is not None:
            self.child.kill()
            self.child.communicate()
            self.child = None


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


def serve() -> None:
    """The child: run the command of each line, answer with its exit code and what stands on standard error."""
    answers = os.fdopen(os.dup(1), "wb", 0)
    from photonormal.cli import main

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


if __name__ == "__main__":
    serve()
