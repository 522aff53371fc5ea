"""Why a file or a folder can't be written, in one line."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from photonormal.types import InputError, MachineLimit

REASONS = {
    errno.ENOSPC: "no space is left; free some or choose another disk",
    errno.EDQUOT: "your share of the disk is used up; free some or choose another disk",
    errno.EACCES: "permission is denied; choose a folder of yours",
    errno.EPERM: "permission is denied; choose a folder of yours",
    errno.EROFS: "the disk is read-only; choose another",
    errno.ENOENT: "its folder does not exist; create it first",
    errno.ENOTDIR: "its folder is a file; choose another place",
    errno.EEXIST: "something of this name is in the way; choose another name",
    errno.ENAMETOOLONG: "its name is too long; choose a shorter one",
}
NOTHING = " Nothing was changed."


class InUse(InputError):
    """Another process is writing there."""


def unwritable(path: Path, error: OSError, after: str = NOTHING) -> MachineLimit:
    """What to raise where `path` can't be written; `after` says what state is left."""
    what = REASONS.get(error.errno or 0, f"{error.strerror or error}; choose another place")
    return MachineLimit(f"{path} can't be written: {what}.{after}")


def refuse_folder(path: Path) -> None:
    """InputError where a file is to be written but a folder is."""
    if path.is_dir() and not path.is_symlink():
        raise InputError(f"{path} is a folder but a file is to be written there; choose another --out.")


def identities(paths: Iterable[Path]) -> set[tuple[int, int]]:
    """What identifies files and folders that exist, whatever name, link or mount leads to them."""
    found = set()
    for path in paths:
        with suppress(OSError, ValueError):
            status = path.stat()
            found.add((status.st_dev, status.st_ino))
    return found


def refuse_taken(
    paths: Iterable[Path],
    overwrite: bool,
    reads: Iterable[Path] = (),
    of_result: Iterable[Path] = (),
    option: str = "--out",
) -> None:
    """InputError where a file to be written is a folder, exists without `overwrite`, is read or belongs to a result.

    Parameters
    ----------
    reads, of_result : the files that are read, and those of a result
    option : what the user names the file by
    """
    used = {"belongs to a result": identities(of_result), "is read here": identities(reads)}
    for path in paths:
        try:
            os.lstat(path)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise unwritable(path, error) from None
        if path.is_dir():
            raise InputError(f"{path} is a folder but a file is to be written there; choose another {option}.")
        for why, files in used.items():
            if identities([path]) & files:
                raise InputError(f"{path} {why} and is not written over; choose another {option}.")
        if not overwrite:
            raise InputError(f"{path} exists; choose another {option}, or add --overwrite to replace it.")


def refuse_filled(folder: Path, overwrite: bool, reads: Iterable[Path] = ()) -> None:
    """InputError where a folder to be written is a file, holds anything without `overwrite`, or holds files read."""
    try:
        there = sorted(folder.iterdir())
    except FileNotFoundError:
        if folder.is_symlink():
            raise InputError(
                f"{folder} is a link to nothing but a folder is to be written; choose another --out."
            ) from None
        return
    except NotADirectoryError:
        raise InputError(f"{folder} is a file but a folder is to be written there; choose another --out.") from None
    except OSError as error:
        raise unwritable(folder, error) from None
    if identities([folder, *there]) & identities(reads):
        raise InputError(f"{folder} is read here and is not written into; choose another --out.")
    if there and not overwrite:
        raise InputError(
            f"{folder} holds files; choose another --out, or add --overwrite to write beside and over them."
        )
