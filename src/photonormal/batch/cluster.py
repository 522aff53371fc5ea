"""Captures measured by the workers of a Dask cluster, of this machine or of many that share the folders."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import photonormal
from photonormal import progress
from photonormal.batch.captures import Named
from photonormal.batch.state import record_failure
from photonormal.batch.work import At, Begun, Measured, Outcome, work
from photonormal.files import memory
from photonormal.types import InputError, cores

ANSWER_S = 10  # in which a scheduler answers
OFTEN_S = 1.0  # between two words about how far a capture is
TOPIC = "photonormal"  # of those words
GPU = "GPU"  # resource of workers that have one: a capture takes one

_one_at_a_time = threading.Lock()  # in a worker, whatever its number of threads


@contextmanager
def cluster(scheduler: str, workers: int | None) -> Iterator[Measured]:
    """What measures captures on the workers of `scheduler`, or on `workers` processes of this machine.

    Raises
    ------
    InputError
        If the scheduler does not answer, a worker has another version of photonormal, or Dask is not installed.
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
            threads = {f"{name}_NUM_THREADS": str(max(1, cores() // count)) for name in ("OMP", "OPENBLAS", "MKL")}
            with config.set({"distributed.nanny.pre-spawn-environ": threads}):
                local = LocalCluster(
                    n_workers=count, threads_per_worker=1, memory_limit=None, dashboard_address="", silence_logs=50
                )
            client = Client(local)
        with client:
            _refuse_other_versions(client)
            yield partial(_run, client, nbytes)
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
        reason = "" if isinstance(error, TimeoutError) else f" ({str(error).splitlines()[0][:200]})"
        raise InputError(
            f"--scheduler {scheduler} does not answer within {ANSWER_S} s{reason}; check that it runs, and its address."
        ) from None


def version() -> str:
    """That of this process."""
    return photonormal.__version__


def _refuse_other_versions(client: Any) -> None:
    found = client.run(version, on_error="return")
    here = photonormal.__version__
    others = {address: v for address, v in found.items() if v != here and not isinstance(v, OSError)}  # it has ended
    if others:
        said = ", ".join(f"{a} {v if isinstance(v, str) else 'none'}" for a, v in list(others.items())[:5])
        more = f" and {len(others) - 5} more" if len(others) > 5 else ""
        raise InputError(
            f"photonormal {here} is here but workers have another version: {said}{more}; install the same everywhere."
        )


def _run(client: Any, nbytes: int, waiting: Sequence[Named], at: At, begun: Begun) -> Iterator[Outcome]:
    """What comes of the captures, as it comes."""
    from distributed import KilledWorker, as_completed

    def heard(event: tuple[float, Any]) -> None:
        name, where, *said = event[1]
        at(name, *said) if said else begun(name, where)

    client.subscribe_topic(TOPIC, heard)
    on_gpus = any(GPU in w.get("resources", {}) for w in client.scheduler_info(n_workers=-1)["workers"].values())
    resources = {GPU: 1} if on_gpus else None
    futures = {
        client.submit(_task, _absolute(n), photonormal.__version__, nbytes, pure=False, resources=resources): n
        for n in waiting
    }
    try:
        for future in as_completed(list(futures)):
            named = futures.pop(future)
            try:
                outcome = future.result()
            except KilledWorker:
                failure = "its workers ended early, one after the other; give them more memory, and run it again."
                record_failure(named.job, "killed", failure, None)
                outcome = Outcome(named.name, 0.0, failure, "killed")
            except (OSError, CancelledError):
                raise InputError(
                    f"the connection to the scheduler was lost with {len(futures) + 1} captures to come; run it again."
                ) from None
            except Exception as error:  # of a worker that has come without photonormal
                failure = f"its worker can't measure: {type(error).__name__}: {' '.join(str(error).split())[:300]}"
                outcome = Outcome(named.name, 0.0, failure, "killed")
            yield outcome
    finally:
        client.unsubscribe_topic(TOPIC)
        client.cancel(list(futures))


def _absolute(named: Named) -> Named:
    """The capture by paths that hold wherever a worker stands."""
    job = named.job
    reading = {k: v.absolute() if isinstance(v, Path) and v.exists() else v for k, v in job.reading.items()}
    camera = job.camera and job.camera.absolute()
    job = replace(job, capture=job.capture.absolute(), out=job.out.absolute(), reading=reading, camera=camera)
    return replace(named, job=job)


def _task(named: Named, needed: str, nbytes: int) -> Outcome:
    """What a worker does with a capture; it may have come after the others were asked for their version."""
    from distributed import get_worker

    worker = get_worker()
    if photonormal.__version__ != needed:
        here = f"worker {worker.address} has photonormal {photonormal.__version__}"
        return Outcome(named.name, 0.0, f"{here} but {needed} is needed; install that there.", "killed")
    limit = worker.memory_manager.memory_limit  # pyright: ignore[reportAttributeAccessIssue]
    allowed = nbytes or (limit or 0) // 2
    told = 0.0

    def tell(title: str, done: int, total: int | None) -> None:
        nonlocal told
        if time.monotonic() - told >= OFTEN_S:
            told = time.monotonic()
            worker.log_event(TOPIC, (named.name, worker.address, title, done, total))

    with _one_at_a_time:
        if allowed:
            memory.allow(f"{allowed // 10**6}MB")
        worker.log_event(TOPIC, (named.name, worker.address))
        progress.tell_to(tell)
        return work(named)
