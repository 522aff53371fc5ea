"""Captures measured by the workers of a Dask cluster, of this machine or of many that share the folders."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import photonormal
from photonormal import progress
from photonormal.batch.captures import Named
from photonormal.batch.state import record_failure, state_of
from photonormal.batch.work import At, Begun, Measured, Outcome, use_threads, work
from photonormal.disk import in_use
from photonormal.files import memory
from photonormal.job import SolvedRows, divided, solve_part
from photonormal.provenance import ProgramVersion, program
from photonormal.resources import cores
from photonormal.types import InputError, a_few

ANSWER_S = 10  # in which a scheduler answers
ALONE_S = 60.0  # that workers have for captures that they are at, once the scheduler is lost
OFTEN_S = 1.0  # between two words about how far a capture is
TOPIC = "photonormal"  # of those words
GPU = "GPU"  # resource of workers that have one: a capture takes one

_one_at_a_time = threading.Lock()  # in a worker, whatever its number of threads


class Split(NamedTuple):
    """Which captures several workers solve, each some rows: those larger than `megapixels`, in `parts` at most."""

    megapixels: float
    parts: int


@dataclass(frozen=True)
class Large:
    """A capture that several workers are to solve."""

    rows: list[slice]


@contextmanager
def cluster(scheduler: str, workers: int | None, split_megapixels: float | None = None) -> Iterator[Measured]:
    """What measures captures on the workers of `scheduler`, or on `workers` processes of this machine; of captures
    larger than `split_megapixels` each worker solves some rows.

    Raises
    ------
    InputError
        If the scheduler does not answer, a worker has another version or other code of photonormal, or Dask is not
        installed.
    """
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError("a cluster needs Dask, which is not installed: pip install 'photonormal[cluster]'.") from None
    for name in ("distributed", "distributed.client", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    local, nbytes = None, 0
    try:
        if scheduler:
            client = _connected(scheduler, Client)
        else:
            count = workers or cores()
            nbytes = memory.allowed() // count
            threads = {f"{name}_NUM_THREADS": str(max(1, cores() // count)) for name in ("OMP", "MKL")}
            with config.set({"distributed.nanny.pre-spawn-environ": threads}):
                local = LocalCluster(
                    n_workers=count, threads_per_worker=1, memory_limit=None, dashboard_address="", silence_logs=50
                )
            client = Client(local)
        with client:
            _refuse_others(client)
            yield partial(_run, client, nbytes, split_megapixels)
    finally:
        if local is not None:
            local.close()


def _connected(scheduler: str, client: Callable[..., Any]) -> Any:
    if not re.fullmatch(r"(tcp|tls|ws|wss)://[^\s/]+:\d{1,5}", scheduler):
        raise InputError(
            f"--scheduler {scheduler} came but an address such as tcp://192.168.1.2:8786 is needed; give it."
        )
    try:
        return client(scheduler, timeout=ANSWER_S)
    except (OSError, ValueError) as error:
        late = isinstance(error, TimeoutError) or "Timed out" in str(error)
        reason = "" if late else f" ({str(error).splitlines()[0][:200]})"
        raise InputError(
            f"--scheduler {scheduler} does not answer within {ANSWER_S} s{reason}; check that it runs, and its address."
        ) from None
    except Exception:  # such as the length of a message that was none
        raise InputError(
            f"--scheduler {scheduler} is answered by something that is no Dask scheduler; check its address and port."
        ) from None


def _refuse_others(client: Any) -> None:
    """InputError where workers have another photonormal."""
    found = client.run(program, on_error="return")
    here = program()
    others = {address: p for address, p in found.items() if p != here and not isinstance(p, OSError)}  # it has ended
    if others:
        said = a_few([f"{address} {_other(p)}" for address, p in others.items()], 5)
        raise InputError(
            f"photonormal {here.version} is here but workers have another: {said}; install the same everywhere, "
            "and start those workers again."
        )


def _other(there: ProgramVersion | Exception) -> str:
    """Which photonormal a worker has that has not the one that is here."""
    if isinstance(there, ModuleNotFoundError):
        return "has none"
    if isinstance(there, Exception):
        return "has one that can't be asked"
    return f"has {there.version}" + " with other code or weights" * (there.version == photonormal.__version__)


def _run(
    client: Any, nbytes: int, megapixels: float | None, waiting: Sequence[Named], at: At, begun: Begun
) -> Iterator[Outcome]:
    """What comes of the captures, as it comes."""
    from distributed import as_completed

    running: dict[str, float] = {}  # since when

    def heard(event: tuple[float, Any]) -> None:
        name, where, *said = event[1]
        if said:
            at(name, *said)
        else:
            running[name] = time.monotonic()
            begun(name, where)

    client.subscribe_topic(TOPIC, heard)
    there = client.scheduler_info(n_workers=-1)["workers"]
    resources = {GPU: 1} if any(GPU in w.get("resources", {}) for w in there.values()) else None
    split = megapixels and Split(megapixels, len(there))
    machines = Counter(worker["host"] for worker in there.values())
    shares = {where: machines[worker["host"]] for where, worker in there.items()}

    def submit(task: Callable[..., Any], named: Named, *more: Any, priority: int = 0) -> Any:
        words = _absolute(named), program(), nbytes, *more
        return client.submit(task, *words, pure=False, resources=resources, priority=priority)

    futures = {submit(_measure, named, split): named for named in waiting}
    coming = as_completed(list(futures))
    try:
        for future in coming:
            named = futures.pop(future)
            try:
                outcome = _outcome(future, named)
            except (OSError, CancelledError):
                left = [named, *futures.values()]
                ended = list(_ended_alone([(n, running[n.name]) for n in left if n.name in running]))
                yield from ended
                raise InputError(
                    f"the connection to the scheduler was lost with {len(left) - len(ended)} captures to come; run it "
                    "again."
                ) from None
            if isinstance(outcome, Large):  # before captures that have not begun
                parts = [submit(_solve, named, rows, priority=1) for rows in outcome.rows]
                whole = submit(_measure, named, None, parts, {} if futures else shares, priority=1)
                futures[whole] = named
                coming.add(whole)
            else:
                yield outcome
    finally:
        client.unsubscribe_topic(TOPIC)
        client.cancel(list(futures))


def _outcome(future: Any, named: Named) -> Outcome | Large:
    """What came of a capture; OSError or CancelledError where the scheduler is lost."""
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker:
        failure = "its workers ended early, one after the other; give them more memory, and run it again."
        record_failure(named.job, "killed", failure, None)
    except (OSError, CancelledError):
        raise
    except Exception as error:  # of a worker that has come without photonormal
        failure = f"its worker can't measure: {type(error).__name__}: {' '.join(str(error).split())[:300]}"
    return Outcome(named.name, 0.0, failure, "killed")


def _ended_alone(running: Sequence[tuple[Named, float]]) -> Iterator[Outcome]:
    """The captures that their workers, running since then, have still ended without a scheduler."""
    deadline = time.monotonic() + ALONE_S
    for named, since in running:
        while in_use(named.job.out) and time.monotonic() < deadline:
            time.sleep(OFTEN_S)
        if state_of(named.job).kind == "done":
            yield Outcome(named.name, time.monotonic() - since)


def _absolute(named: Named) -> Named:
    """The capture by paths that hold wherever a worker stands."""
    job = named.job
    reading = {k: v.absolute() if isinstance(v, Path) and v.exists() else v for k, v in job.reading.items()}
    camera = job.camera and job.camera.absolute()
    job = replace(job, capture=job.capture.absolute(), out=job.out.absolute(), reading=reading, camera=camera)
    return replace(named, job=job)


def _measure(
    named: Named,
    needed: ProgramVersion,
    nbytes: int,
    split: Split | None,
    parts: Sequence[SolvedRows | Exception] = (),
    shares: Mapping[str, int] = {},
) -> Outcome | Large:
    """What a worker does with a capture, or with what others have found of its rows. Where one of them has failed, it
    does all by itself, and says what fails again. `shares` of its machine that it may use, by its address: as many as
    there are workers, where none of them has anything else to do."""
    try:
        with _at_work(named, needed, nbytes, begins=not parts, shares=shares):
            if split:
                with suppress(Exception):  # which fails again
                    rows = divided(named.job, *split)
                    if len(rows) > 1:
                        return Large(rows)
            found = [part for part in parts if isinstance(part, SolvedRows)]
            return work(named, found if len(found) == len(parts) else ())
    except OtherProgram as error:
        return Outcome(named.name, 0.0, str(error), "killed")


def _solve(named: Named, needed: ProgramVersion, nbytes: int, rows: slice) -> SolvedRows | Exception:
    """What a worker does with some rows of a capture."""
    try:
        with _at_work(named, needed, nbytes, reporting=rows.start == 0):
            return solve_part(named.job, rows)
    except Exception as error:
        return error


class OtherProgram(Exception):
    """A worker has another photonormal."""


@contextmanager
def _at_work(
    named: Named,
    needed: ProgramVersion,
    nbytes: int,
    begins: bool = False,
    reporting: bool = True,
    shares: Mapping[str, int] = {},
) -> Iterator[None]:
    """A worker works on one thing at a time, and reports how far it is; OtherProgram if it has come with another
    photonormal after the others were asked."""
    from distributed import get_worker

    worker = get_worker()
    if program() != needed:
        there = f"worker {worker.address} {_other(program())}"
        raise OtherProgram(f"photonormal {needed.version} is needed but {there}; install the same there.")
    limit = worker.memory_manager.memory_limit  # pyright: ignore[reportAttributeAccessIssue]
    allowed = nbytes or (limit or 0) // 2
    last_report = 0.0

    def tell(title: str, done: int, total: int | None) -> None:
        nonlocal last_report
        if reporting and time.monotonic() - last_report >= OFTEN_S:
            last_report = time.monotonic()
            worker.log_event(TOPIC, (named.name, worker.address, title, done, total))

    with _one_at_a_time:
        if allowed:
            memory.allow(f"{allowed // 10**6}MB")
        if begins:
            worker.log_event(TOPIC, (named.name, worker.address))
        progress.tell_to(tell)
        use_threads(_own_threads() * shares.get(worker.address, 1))
        yield


@cache
def _own_threads() -> int:
    """Those of a worker's computations, as Dask began it."""
    import torch

    return torch.get_num_threads()
