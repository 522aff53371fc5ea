"""How far the work is, and the time that is left: a bar on a terminal, else a line every half minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

EVERY = 30.0  # seconds between lines
Told = Callable[[str, int, int | None], None]  # what is being done, steps done and in all

_told: Told | None = None


def tell_to(told: Told) -> None:
    """From now on whatever this process does is reported to `told`, from any thread, in place of standard error."""
    global _told
    _told = told


@contextmanager
def progress(title: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Tell on standard error how far the block is; call what it yields once for each of `total` steps done.

    Called with a number, that many steps are done. Several threads may call it. What takes less than half a minute
    says nothing where there is no terminal.
    """
    with (_telling if _told else _bar if sys.stderr.isatty() else _lines)(title, total) as advance:
        yield advance


class Several:
    """How far some work is that goes on in several places at once: `advance` once for each part done, `at` for how far
    a part is, `gone` at its end."""

    def __init__(self, bars: Any = None, whole: Any = None, advance: Callable[..., None] = lambda: None) -> None:
        self._bars, self._whole, self._advance = bars, whole, advance
        self._parts: dict[str, Any] = {}

    def advance(self) -> None:
        """One more part is done."""
        if self._bars is None:
            self._advance()
        else:
            self._bars.advance(self._whole)

    def at(self, part: str, title: str, done: int, total: int | None) -> None:
        """How far a part is."""
        if self._bars is not None:
            if part not in self._parts:
                self._parts[part] = self._bars.add_task(part)
            self._bars.update(self._parts[part], description=f"{part}: {title}", completed=done, total=total)

    def gone(self, part: str) -> None:
        """A part goes on no longer."""
        if self._bars is not None and part in self._parts:
            self._bars.remove_task(self._parts.pop(part))


@contextmanager
def several(title: str, total: int) -> Iterator[Several]:
    """As `progress`, for work whose parts go on in several places at once: a bar for each of them, and one for all."""
    if sys.stderr.isatty():
        with _bars() as bars:
            yield Several(bars, bars.add_task(title, total=total))
    else:
        with _lines(title, total) as advance:
            yield Several(advance=advance)


@contextmanager
def _telling(title: str, total: int | None) -> Iterator[Callable[..., None]]:
    assert _told is not None
    told, done = _told, 0
    told(title, 0, total)

    def advance(steps: int = 1) -> None:
        nonlocal done
        done += steps
        told(title, done, total)

    yield advance


@contextmanager
def _bar(title: str, total: int | None) -> Iterator[Callable[..., None]]:
    with _bars() as bars:
        task = bars.add_task(title, total=total)
        yield lambda steps=1: bars.advance(task, steps)


def _bars() -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


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
