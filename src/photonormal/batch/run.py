"""A batch: what is not done of its captures is measured, and the summary of all is written."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from photonormal.batch.captures import FoundCaptures, Named
from photonormal.batch.state import CaptureState, state_of
from photonormal.batch.summary import Summary
from photonormal.batch.work import Begun, Measured, Outcome
from photonormal.disk import in_use
from photonormal.progress import Several, several
from photonormal.types import InputError

EVERY_S = 10.0  # between two summaries while captures are measured
LOOK_S = 0.5  # between two looks at a capture that another process is at
Event = Callable[..., None]  # what happened, to which capture, and more


def run_batch(
    found: FoundCaptures,
    out: Path,
    tell: Event,
    measured: Measured,
    retry: bool = False,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Measure the captures that are not done, and write the summary; returns how many there are of each kind.

    Parameters
    ----------
    found : what to measure, as `photonormal.batch.captures.jobs` names it
    out : folder of the batch
    tell : is called with an event and what belongs to it: ("found", captures=..., waiting=..., left_out=...),
        ("stale", capture=..., why=...), ("begun", capture=..., where=...), ("done", capture=..., seconds=..., ...),
        ("failed", capture=..., kind=..., message=...), ("busy", captures=[...]), ("summary", ...)
    measured : gives what comes of the captures: `photonormal.batch.workers.work_through`, or a cluster's
    retry : try again what has failed before in the same way
    overwrite : make results of other options again, and write beside what is no result

    Raises
    ------
    InputError
        If there is no such method or option, or `out` holds other things, or results of other options, without
        `overwrite`. Nothing has been measured then.
    """
    captures = found.captures
    for named in captures:
        named.job.made()  # there is such a method
    states = {named.name: state_of(named.job) for named in captures}
    others = [(name, s) for name, s in states.items() if s.kind == "options"]
    if others and not overwrite:
        name, state = others[0]
        more = f", and {len(others) - 1} more" if len(others) > 1 else ""
        raise InputError(
            f"{out / name} was made with other options ({state.why}){more}; give those, choose another --out, or add "
            "--overwrite to measure again."
        )
    summary = Summary(out, states, overwrite)
    summary.write()
    waiting = [named for named in captures if _wanted(states[named.name], retry)]
    counts = Counter(kept=len(captures) - len(waiting))
    tell("found", captures=len(captures), waiting=len(waiting), left_out=[str(path) for path in found.left_out])
    for name, state in states.items():
        if state.kind in ("stale", "options"):
            tell("stale", capture=name, why=state.why)
        elif state.kind == "failed" and not retry:
            counts.update(kept=-1, failed=1)
            tell("failed", capture=name, kind="before", message=state.why)
    try:
        with several(f"{len(waiting)} capture{'s' * (len(waiting) != 1)}", len(waiting)) as bars:

            def begun(name: str, where: str) -> None:
                bars.at(name, "begun", 0, None)
                tell("begun", capture=name, where=where)

            written = time.monotonic()
            for outcome in _outcomes(waiting, measured, bars, begun, tell):
                bars.advance()
                summary.read(outcome.name)
                counts.update([_told(outcome, tell)])
                if time.monotonic() - written > EVERY_S:
                    summary.write()
                    written = time.monotonic()
    finally:
        summary.read_others()
        summary.write()
    numbers = {key: counts[key] for key in ("measured", "kept", "failed")}
    tell("summary", **numbers, out=str(out))
    return numbers


def _outcomes(waiting: list[Named], measured: Measured, bars: Several, begun: Begun, tell: Event) -> Iterator[Outcome]:
    """What comes of the captures, as it comes. Those that another process is just at come last, once it has ended, and
    are measured where it has left no result."""
    while waiting:
        busy: set[str] = set()
        for outcome in measured(waiting, bars.at, begun):
            bars.gone(outcome.name)
            if outcome.busy:
                busy.add(outcome.name)
            else:
                yield outcome
        waiting = [named for named in waiting if named.name in busy]
        if waiting:
            tell("busy", captures=[named.name for named in waiting])
        for named in waiting:
            while in_use(named.job.out):
                time.sleep(LOOK_S)


def _wanted(state: CaptureState, retry: bool) -> bool:
    return state.kind not in ("done", "failed") or (state.kind == "failed" and retry)


def _told(outcome: Outcome, tell: Event) -> str:
    if outcome.failure:
        tell("failed", capture=outcome.name, kind=outcome.kind, message=outcome.failure)
        return "failed"
    tell("done", capture=outcome.name, seconds=round(outcome.seconds, 3), **(outcome.numbers or {}))
    return "measured"
