"""The first lines of the command `photonormal`: Ctrl-C and SIGTERM end it cleanly, even while the rest is loading."""

from __future__ import annotations

import gc
import os
import signal
import sys


def main() -> int:
    """Run the command line; returns the exit code, as `photonormal.cli.main` does, or 143 after SIGTERM."""
    came: list[int] = []

    def end(number: int, _: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    code = 0
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, end)
        from photonormal import cli

        code = cli.main(interrupted=lambda: bool(came))
        for number in (signal.SIGINT, signal.SIGTERM):  # all is done but for what Python does at its end
            signal.signal(number, signal.SIG_IGN)
    except BaseException:
        if not came:
            raise
    if came:
        sys.stderr.flush()
        os._exit(128 + came[0])  # what threads were still computing is of no use to anyone
    gc.freeze()  # the process ends: to look through all that it has loaded for garbage would take half a second
    return code
