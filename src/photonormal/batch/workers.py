"""Processes of this machine that measure one capture at a time each. One that ends, however it does, takes nothing
with it: another takes its place, and its capture is tried again."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from photonormal import progress
from photonormal.batch.captures import Named
from photonormal.batch.state import record_failure
from photonormal.batch.work import At, Begun, Outcome, use_threads, work
from photonormal.files import memory
from photonormal.resources import cores

LOADED = "photonormal.batch.loaded"  # has imported what measuring needs
TRIES = 3  # of a capture whose process ends early
EACH = memory.LEAST  # bytes that a process may use, at least
OFTEN_S = 0.2  # between two words about how far a capture is
PATIENCE_S = 10.0  # for processes that are to end


def how_many(jobs: int | None, captures: int) -> int:
    """Processes at a time: as asked for, or as many as there are cores and the memory allowed holds."""
    return min(captures, jobs or min(cores(), max(1, memory.allowed() // EACH)))


def _context() -> Any:
    """How processes begin. Elsewhere than on Linux, libraries of the system don't bear it to be copied."""
    return multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")


class Worker:
    """One process and the pipe to it."""

    def __init__(self, threads: int, nbytes: int) -> None:
        context = _context()
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, threads, nbytes), daemon=True)
        with beginning():
            self.process.start()
        theirs.close()
        self.named: Named | None = None

    def begin(self, named: Named) -> None:
        """Give it a capture."""
        self.named = named
        with contextlib.suppress(OSError):  # it has ended, which the next look at the pipe shows
            self.pipe.send(named)


def begin_loading() -> None:
    """On Linux the processes come of one that has loaded everything; it begins to, if it has not."""
    if _context().get_start_method() == "forkserver":
        from multiprocessing import forkserver

        multiprocessing.set_forkserver_preload([LOADED])
        with beginning():
            forkserver.ensure_running()


def work_through(waiting: Sequence[Named], at: At, begun: Begun, jobs: int | None = None) -> Iterator[Outcome]:
    """What comes of the captures, as it comes, from `jobs` processes; None: as many as cores and memory allow.

    One that has ended a capture has the next before the outcome is reported.
    """
    if not waiting:
        return
    begin_loading()
    count = how_many(jobs, len(waiting))
    todo, died = deque(waiting), Counter()
    workers: list[Worker] = []
    threads, nbytes = max(1, cores() // count), memory.allowed() // count

    def give(worker: Worker) -> None:
        if todo:
            named = todo.popleft()
            worker.begin(named)
            begun(named.name, f"process {worker.process.pid}")

    try:
        while todo or any(w.named for w in workers):
            while todo and len(workers) < count:
                workers.append(Worker(threads, nbytes))
            for worker in [w for w in workers if w.named is None]:
                give(worker)
            for pipe in wait([w.pipe for w in workers if w.named]):
                worker = next(w for w in workers if w.pipe is pipe)
                named = worker.named
                assert named is not None
                try:
                    said = worker.pipe.recv()
                except (EOFError, OSError):
                    workers.remove(worker)
                    _end([worker])
                    died[named.name] += 1
                    if died[named.name] < TRIES:
                        todo.append(named)
                    else:
                        yield _ended_early(named, worker.process.exitcode)
                    continue
                if isinstance(said, Outcome):
                    worker.named = None
                    give(worker)
                    yield said
                else:
                    at(named.name, *said)
    finally:
        _end(workers)


@contextlib.contextmanager
def beginning() -> Iterator[None]:
    """A process that begins in the block never hears of Ctrl-C, not even while it is loading."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end(workers: Sequence[Worker]) -> None:
    """End processes: idle ones at once, others as cleanly as Ctrl-C ends a command; at last in any way."""
    for worker in workers:
        worker.pipe.close()
        if worker.named is not None:
            worker.process.terminate()
    deadline = time.monotonic() + PATIENCE_S
    for worker in workers:
        worker.process.join(max(0.0, deadline - time.monotonic()))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


def _ended_early(named: Named, code: int | None) -> Outcome:
    how = signal.Signals(-code).name if code is not None and code < 0 else f"code {code}"
    failure = f"its process ended with {how} {TRIES} times; give fewer --jobs if memory is short, and run it again."
    record_failure(named.job, "killed", failure, None)
    return Outcome(named.name, 0.0, failure, "killed")


def _serve(pipe: Connection, threads: int, nbytes: int) -> None:
    """A process of the batch, until its pipe or a signal ends it."""
    code = 1
    try:
        _answer(pipe, threads, nbytes)
    except (EOFError, OSError, KeyboardInterrupt):
        code = 0
    finally:
        os._exit(code)  # without the libraries' last acts, which a signal would disturb


def _answer(pipe: Connection, threads: int, nbytes: int) -> None:
    """Captures come through the pipe, outcomes go."""
    began(threads)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    memory.allow(f"{nbytes // 10**6}MB")
    one_at_a_time, last_report = threading.Lock(), 0.0

    def tell(title: str, done: int, total: int | None) -> None:
        nonlocal last_report
        with one_at_a_time:
            now = time.monotonic()
            if now - last_report >= OFTEN_S:
                last_report = now
                pipe.send((title, done, total))

    progress.tell_to(tell)
    while True:
        named: Named = pipe.recv()
        outcome = work(named)
        with one_at_a_time:
            pipe.send(outcome)


def began(threads: int) -> None:
    """What a process of a batch begins with: Ctrl-C is its parent's, whose SIGTERM ends it as cleanly."""

    def end(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, end)
    use_threads(threads)


def _end_with_parent() -> None:
    """A batch that is killed leaves no process behind; what was being written, the next run puts right."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
