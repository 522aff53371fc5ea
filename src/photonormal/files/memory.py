"""How much memory the process may use: what `--memory` says, or half of what is free when it is first asked; and where
scratch files lie that spare it."""

from __future__ import annotations

import errno
import os
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import IO
from weakref import WeakValueDictionary

import numpy as np

from photonormal.types import InputError, MachineLimit

SHARE = 8  # one file may take this part of it, decoded: samples become floats, and several are worked on at a time
PICTURES, WORK = 3, 1_200_000_000  # a capture's pictures may take this part of what lies beyond these bytes, which
SMALL = 24  # libraries and small windows take; or this part of all; else they lie on disk
LEAST = 2 * 2**30  # bytes that are allowed on any machine
UNITS = {"KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
UNRESERVED = {errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP}  # errors of file systems that keep no room beforehand
CGROUP = Path("/sys/fs/cgroup")  # where a container's own limit stands on Linux

_given: int | None = None
_held: WeakValueDictionary[int, np.ndarray] = WeakValueDictionary()


def allow(text: str) -> None:
    """Take the bound from a text such as 3GB, for the whole process; an empty text changes nothing."""
    global _given
    if not text:
        return
    match = re.fullmatch(r"\s*([0-9]{1,6}(?:\.[0-9]{1,6})?)\s*([KMGT]B)\s*", text.upper())
    if match is None or float(match[1]) == 0:
        raise InputError(f"--memory {text[:40]!r} came but an amount like 3GB is needed; correct it.")
    _given = int(float(match[1]) * UNITS[match[2]])


def allowed() -> int:
    """Bytes that the process may use."""
    return _half_of_what_is_free() if _given is None else _given


def holds(nbytes: int) -> bool:
    """Whether a capture's decoded pictures lie in memory: at the side of what is done with them."""
    return nbytes <= max((allowed() - WORK) // PICTURES, allowed() // SMALL)


def hold(samples: np.ndarray) -> None:
    """Count pictures as held as long as they are."""
    _held[id(samples)] = samples


def held() -> int:
    """Bytes of pictures that lie in memory."""
    return sum(samples.nbytes for samples in _held.values())


def to_hold(nbytes: int) -> int:
    """Bytes that have to be allowed so that pictures of so many lie in memory."""
    return min(PICTURES * nbytes + WORK, SMALL * nbytes)


def check(nbytes: int, what: str) -> None:
    """Raise MachineLimit where `what` would take more than its share of the memory once it is decoded."""
    if nbytes * SHARE > allowed():
        raise MachineLimit(
            f"{what} would take {text_of(nbytes)} but one file may take {text_of(allowed() // SHARE)}, an eighth of "
            f"the memory allowed; give a smaller one, or allow more, such as --memory {text_of(nbytes * SHARE, '')}."
        )


def text_of(nbytes: int, space: str = " ") -> str:
    """An amount as people write it.

    >>> text_of(1_500_000_000)
    '1.5 GB'
    """
    unit = next((u for u in reversed(UNITS) if nbytes >= UNITS[u]), "KB")
    return f"{-(-10 * nbytes // UNITS[unit]) / 10:g}{space}{unit}"


def scratch_folder() -> Path:
    """Where scratch files lie: TMPDIR where it is set, else a folder that is on disk, not in memory."""
    on_disk = Path("/var/tmp")
    if "TMPDIR" not in os.environ and on_disk.is_dir() and os.access(on_disk, os.W_OK):
        return on_disk
    return Path(tempfile.gettempdir())


def scratch_file(nbytes: int, otherwise: str = "") -> IO[bytes]:
    """A file of so many bytes without a name, which is gone once it is closed or the process ends.

    Raises
    ------
    MachineLimit
        If the disk has no room for it; `otherwise` is what else may be done.
    """
    folder = scratch_folder()
    free = shutil.disk_usage(folder).free
    if nbytes > free:
        raise MachineLimit(
            f"a scratch file of {text_of(nbytes)} is needed but {folder} has {text_of(free)} free; free some, set "
            f"TMPDIR to a folder on another disk{otherwise}."
        )
    file = tempfile.TemporaryFile(prefix="photonormal-", dir=folder, buffering=0)
    try:
        file.truncate(nbytes)
        if nbytes and hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, nbytes)
    except OSError as error:
        if error.errno in UNRESERVED:
            return file
        file.close()
        raise MachineLimit(
            f"a scratch file of {text_of(nbytes)} can't be written in {folder} ({error.strerror}); set TMPDIR to a "
            f"folder on another disk{otherwise}."
        ) from None
    return file


@cache
def _half_of_what_is_free() -> int:
    import psutil

    free = psutil.virtual_memory().available
    try:
        limit, used = ((CGROUP / name).read_text().strip() for name in ("memory.max", "memory.current"))
        free = min(free, int(limit) - int(used)) if limit != "max" else free
    except (OSError, ValueError):  # no container, or another system
        pass
    return max(LEAST, free // 2)
