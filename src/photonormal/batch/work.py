"""What every process that works for a batch does with one capture, whoever gave it the work."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from photonormal.batch.captures import Named
from photonormal.batch.row import PAGE
from photonormal.batch.state import Kind, record_failure, state_of
from photonormal.disk import InUse
from photonormal.resources import take_share
from photonormal.types import InputError, MachineLimit, code_of_others

if TYPE_CHECKING:
    from photonormal.job import SolvedRows


@dataclass(frozen=True)
class Outcome:
    """What came of one capture.

    Parameters
    ----------
    failure : why there is no result, one line; "": there is one
    kind : of the failure
    numbers : of the result, for events
    busy : whether nothing came of it since another process is writing its result
    """

    name: str
    seconds: float
    failure: str = ""
    kind: Kind = "input"
    numbers: dict[str, Any] | None = None
    busy: bool = False


At = Callable[[str, str, int, int | None], None]  # of a capture: what is being done, steps done and in all
Begun = Callable[[str, str], None]  # a capture, and where
Measured = Callable[[Sequence[Named], At, Begun], Iterator[Outcome]]  # what comes of captures, as it comes


def use_threads(count: int) -> None:
    """Whatever this process computes with takes so many threads at most; others work beside it."""
    import cv2
    import torch

    torch.set_num_threads(count)
    cv2.setNumThreads(count)
    take_share(count)


def work(named: Named, parts: Sequence[SolvedRows] = ()) -> Outcome:
    """Measure one capture and write its result, or say in its folder why that can't be.

    `parts`: what other processes have found of its rows.
    """
    from photonormal.job import carry_out
    from photonormal.resources import reset_peak
    from photonormal.view.show import small_page

    start, read = time.perf_counter(), {}
    reset_peak()
    try:
        if state_of(named.job).kind == "done":  # another batch has measured it since
            return Outcome(named.name, time.perf_counter() - start)
        report = carry_out(named.job, read, parts, lambda result: {PAGE: small_page(result, named.name)})
    except InUse:
        return Outcome(named.name, time.perf_counter() - start, busy=True)
    except MachineLimit as error:
        kind, failure = "killed", str(error)
    except InputError as error:
        kind, failure = "input", str(error)
    except MemoryError:
        kind, failure = "killed", "memory is not enough for it; give fewer --jobs, or more memory."
    except Exception as error:  # whatever one capture fails with, the others go on
        what, place = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}", code_of_others(error)
        failure = (
            f"{what}, raised in {place}, which is no part of photonormal."
            if place
            else f"a fault of photonormal: {what}"
        )
        kind = "fault"
    else:
        numbers = {"pixels": report["pixels"]["measured"], "expected_error_deg": report.get("expected_error_deg")}
        return Outcome(named.name, time.perf_counter() - start, numbers=numbers)
    record_failure(named.job, kind, failure, read)
    return Outcome(named.name, time.perf_counter() - start, failure, kind)
