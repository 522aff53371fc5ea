"""Processors and memory of a process: how many it may use, the peak of one step, what the system gets back."""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from threadpoolctl import ThreadpoolController

KEPT = 2**29  # bytes that a process may hold: what a small capture frees, the next one needs again

S = TypeVar("S")
T = TypeVar("T")


def reset_peak() -> None:
    """Start to measure anew: on Linux the process' peak is set back, elsewhere it only grows."""
    import torch

    if torch.cuda.is_available():
        torch.cuda.reset_peak_memory_stats()
    hand_back()
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        pass


def hand_back() -> None:
    """Give the system the memory that was freed, which the C library else keeps for later (glibc only); not where the
    process holds no more than KEPT."""
    import psutil

    if platform.libc_ver()[0] == "glibc" and psutil.Process().memory_info().rss > KEPT:
        with suppress(OSError, AttributeError):
            ctypes.CDLL("libc.so.6").malloc_trim(0)


def peak_mb() -> float | None:
    """Largest resident size since `reset_peak`, in MiB; None where the system does not say."""
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return round(int(line.split()[1]) / 1024, 1)
    except OSError:
        pass
    try:
        import resource
    except ImportError:
        return None
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit, 1)


def gpu_peak_mb() -> float | None:
    """Largest GPU memory held by tensors since `reset_peak`, in MiB; None without a GPU."""
    import torch

    return round(torch.cuda.max_memory_allocated() / 2**20, 1) if torch.cuda.is_available() else None


def processor() -> str:
    """The processor's name, as far as the system says it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


_share: int | None = None


def cores() -> int:
    """Processors that this process may use: those that it may run on, or its share of them."""
    return _share or (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def take_share(threads: int) -> None:
    """From now on this process uses so many processors: others work beside it."""
    global _share
    _share = threads


@contextmanager
def by_one_thread() -> Iterator[None]:
    """numpy, SciPy and torch compute by one thread in the block, or in a function that has this as its decorator.

    For many small steps: threads that share each of them wait for one another, which takes ten times as long as the
    steps themselves where other programs run, too.
    """
    torch = sys.modules.get("torch")
    use, threads = (torch.set_num_threads, torch.get_num_threads()) if torch else (lambda _: None, 1)
    with _libraries(len(sys.modules)).limit(limits=1, user_api="blas"):
        use(1)
        try:
            yield
        finally:
            use(threads)


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """Those that numpy and SciPy compute by; more come only with modules, and to look for them takes milliseconds."""
    return ThreadpoolController()


def in_threads(f: Callable[[S], T], items: Iterable[S], threads: int) -> list[T]:
    """``f`` of every item, in order, by so many threads: by this one where that is one."""
    if threads == 1:
        return [f(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(f, items))
