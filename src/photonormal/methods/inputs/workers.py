"""Blocks of pixels worked on side by side, each by one core."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

import torch

P = TypeVar("P")
T = TypeVar("T")


def side_by_side(f: Callable[[P], T], parts: Iterable[P], device: torch.device, most: int = 2**10) -> list[T]:
    """``f`` of every part, in order: on a processor by as many threads as torch has, or `most`, each with one core.

    Threads that share each small step wait for one another longer than they work where other programs run, too.
    """
    threads, inferring = torch.get_num_threads(), torch.is_inference_mode_enabled()
    if device.type != "cpu" or threads == 1:
        return [f(part) for part in parts]

    def alone(part: P) -> T:
        with torch.inference_mode(inferring):  # a thread's own, as its context
            return f(part)

    torch.set_num_threads(1)  # of this thread, and of those that begin from now on
    try:
        with ThreadPoolExecutor(min(threads, most)) as pool:
            return [done.result() for done in [pool.submit(copy_context().run, alone, part) for part in parts]]
    finally:
        torch.set_num_threads(threads)
