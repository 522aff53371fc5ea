"""Captures that come into a folder, such as a camera's, measured when their last file has stopped growing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from photonormal.capture.pictures import photographs, picture_files
from photonormal.types import InputError

EVERY_S = 1.0  # between two looks at the folder
Files = frozenset[tuple[str, int, int]]  # names, sizes and times


def watch(
    folder: Path,
    out: Path,
    measure: Callable[[Sequence[Path]], object],
    settle_s: float,
    stop: Callable[[], bool] = lambda: False,
    tell: Callable[..., object] = lambda event, **what: None,
) -> None:
    """Give the captures of a folder to `measure` once none of their files has changed for `settle_s`; those that change
    later, again.

    Parameters
    ----------
    folder : holds a folder for each capture; one that holds no file yet is none
    out : folder of the results, which is none either
    measure : what is done with captures that are whole
    stop : is asked every EVERY_S whether to end
    tell : is called with an event and what belongs to it: "watching", and "loose" once, of pictures in no folder

    Raises
    ------
    InputError
        If there is no such folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder but one that captures come into is needed; make it first.")
    if _same(folder, out):
        raise InputError(f"{folder} is watched, and results in it would be taken for captures; choose another --out.")
    seen: dict[Path, tuple[Files, float]] = {}
    given: dict[Path, Files] = {}
    tell("watching", folder=str(folder), out=str(out))
    loose: list[Path] = []
    while not stop():
        now = time.monotonic()
        if not folder.is_dir():
            raise InputError(f"{folder} is no longer there, so nothing can come into it; what came before is measured.")
        if not loose and (loose := photographs(picture_files(folder))):
            tell("loose", folder=str(folder), picture=loose[0].name)
        whole = []
        for path in sorted(p for p in folder.iterdir() if p.is_dir() and p.name[0] != "." and not _same(p, out)):
            files = _files(path)
            if path not in seen or seen[path][0] != files:
                seen[path] = files, now
            elif files and given.get(path) != files and now - seen[path][1] >= settle_s:
                whole.append(path)
                given[path] = files
        if whole:
            measure(whole)
        else:
            time.sleep(EVERY_S)


def _same(path: Path, other: Path) -> bool:
    return other.exists() and path.samefile(other)


def _files(folder: Path) -> Files:
    found = set()
    for path in folder.rglob("*"):
        try:
            status = path.stat()
        except OSError:  # it has just gone
            continue
        if path.is_file():
            found.add((path.relative_to(folder).as_posix(), status.st_size, status.st_mtime_ns))
    return frozenset(found)
