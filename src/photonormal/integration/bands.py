"""Rows of large arrays, worked on side by side."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import TypeVar

from photonormal.resources import cores

BLOCK = 2**16  # pixels that are worked on at a time: what a cache holds
LEAST = 16  # rows, so that those which bands share are few
WORTH = 2**18  # pixels from which on a second core is worth its start

T = TypeVar("T")


def each_band(work: Callable[[slice], T], h: int, w: int) -> list[T]:
    """What `work` returns of some rows after the other; by all cores where there are many pixels.

    Which rows go together does not depend on the number of cores, nor does what is summed over the bands.
    """
    rows = max(LEAST, BLOCK // max(w, 1))
    bands = [slice(y, min(y + rows, h)) for y in range(0, h, rows)]
    threads = min(cores(), len(bands))
    if threads == 1 or h * w < WORTH:
        return [work(band) for band in bands]
    pool = _pool(os.getpid(), threads)
    ends = [len(bands) * k // threads for k in range(threads + 1)]
    shares = [pool.submit(lambda own: [work(band) for band in own], bands[a:b]) for a, b in pairwise(ends)]
    return [found for share in shares for found in share.result()]


def around(rows: slice, h: int, margin: int = 1) -> tuple[slice, slice]:
    """`rows` of h with so many more on each side, as far as there are any; and where `rows` lie among them."""
    first = max(rows.start - margin, 0)
    return slice(first, min(rows.stop + margin, h)), slice(rows.start - first, rows.stop - first)


@cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """Threads of this process: a forked one has none of its parent's."""
    return ThreadPoolExecutor(threads)
