"""How far the work is, and the time that is left: a bar on a terminal, else a line every half minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

EVERY = 30.0  # seconds between lines


@contextmanager
def progress(title: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Tell on standard error how far the block is; call what it yields once for each of `total` steps done.

    Called with a number, that many steps are done. Several threads may call it. What takes less than half a minute
    says nothing where there is no terminal.
    """
    with (_bar if sys.stderr.isatty() else _lines)(title, total) as advance:
        yield advance


@contextmanager
def _bar(title: str, total: int | None) -> Iterator[Callable[..., None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(title, total=total)
        yield lambda steps=1: bars.advance(task, steps)


@contextmanager
def _lines(title: str, total: int | None) -> Iterator[Callable[..., None]]:
    start, done, ended = time.monotonic(), 0, Event()

    def advance(steps: int = 1) -> None:
        nonlocal done
        done += steps

    def tell() -> None:
        while not ended.wait(EVERY):
            print(f"photonormal: {line(title, time.monotonic() - start, done, total)}", file=sys.stderr, flush=True)

    teller = Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield advance
    finally:
        ended.set()
        teller.join()


def line(title: str, seconds: float, done: int, total: int | None) -> str:
    """How far some work is after so many seconds, and what is left if the rest goes as the first part did.

    >>> line("normals", 90, 25, 100)
    'normals: 25 % after 1.5 minutes, 4.5 minutes left'
    >>> line("checking", 60, 0, None)
    'checking: 1 minute so far'
    """
    if not total or not done:
        return f"{title}: {_time(seconds)} so far"
    left = seconds * max(0, total - done) / done
    return f"{title}: {100 * done // total} % after {_time(seconds)}, {_time(left)} left"


def _time(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.0f} seconds"
    if seconds < 5400:
        return f"{seconds / 60:.2g} minutes" if round(seconds / 60, 1) != 1 else "1 minute"
    return f"{seconds / 3600:.2g} hours"
