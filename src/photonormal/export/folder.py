"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from photonormal.types import InputError

REPORT = "report.json"  # a folder that holds it is ours


def write(path: Path, data: bytes) -> None:
    """Write beside the file, then rename: a reader never sees half a file."""
    beside = path.with_name(f".{path.name}.partial")
    try:
        beside.write_bytes(data)
        os.replace(beside, path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise _unwritable(path, error) from None


@contextmanager
def whole_folder(out: Path, overwrite: bool = False) -> Iterator[Path]:
    """A folder to write into, which becomes `out` when the block ends well and vanishes when it does not.

    An existing result of ours is replaced. Any other folder that is not empty is refused, unless `overwrite`; files in
    it that are not ours stay where they are in either case.
    """
    if out.is_file():
        raise InputError(f"{out} is a file but a folder for the results is needed; choose another --out.")
    if out.is_dir() and any(out.iterdir()) and not (out / REPORT).is_file() and not overwrite:
        raise InputError(
            f"{out} exists and holds no photonormal result; choose another --out, or add --overwrite to put the "
            "results beside what is there."
        )
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{out.name}.partial-", dir=out.parent))
    except OSError as error:
        raise _unwritable(out, error) from None
    try:
        yield partial
        _swap(partial, out)
    except OSError as error:
        raise _unwritable(out, error) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _swap(partial: Path, out: Path) -> None:
    partial.chmod(0o777 & ~_umask())
    if not out.exists():
        partial.rename(out)
        return
    for other in out.iterdir():
        if not (partial / other.name).exists():
            other.rename(partial / other.name)
    before = out.with_name(f".{out.name}.before-{os.getpid()}")
    out.rename(before)
    partial.rename(out)
    shutil.rmtree(before)


def _umask() -> int:
    value = os.umask(0)
    os.umask(value)
    return value


def _unwritable(path: Path, error: OSError) -> InputError:
    what = {
        errno.ENOSPC: "no space is left; free some or choose another disk",
        errno.EACCES: "permission is denied; choose a folder of yours",
        errno.EROFS: "the disk is read-only; choose another",
        errno.ENOENT: "its folder does not exist; create it first",
    }.get(error.errno or 0, f"{error.strerror or error}; choose another place")
    return InputError(f"{path} can't be written: {what}. Nothing was changed.")
