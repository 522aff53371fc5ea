"""Several results at a time: those that are named, and all below the folder of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from photonormal.export.folder import REPORT, listed_files, reported_below
from photonormal.handover import FORMATS
from photonormal.types import InputError, by_name
from photonormal.view.result import is_result, report_of

PICTURE, FILM = ".png", ".mp4"  # of several that are relit


class FoundResults(NamedTuple):
    """Folders of results by their names, and names of captures that have none since they failed."""

    results: dict[str, Path]
    without: list[str]


def results_in(places: Sequence[Path]) -> FoundResults:
    """The results that folders are, or that lie below them; those are called by their paths there.

    Raises
    ------
    InputError
        If a folder neither is nor holds a result, or two results have one name.
    """
    found: dict[str, Path] = {}
    without: list[str] = []
    for place in places:
        below = [] if is_result(place) else reported_below(place)
        if not any(map(is_result, below)):
            report_of(place)  # or it says what the folder lacks
        named = {folder.relative_to(place).as_posix(): folder for folder in below if is_result(folder)}
        for name, folder in (named or {place.resolve().name: place}).items():
            if name in found:
                raise InputError(f"{found[name]} and {folder} would both be called {name}; give one of them at a time.")
            found[name] = folder
        without += [
            folder.relative_to(place).as_posix()
            for folder in below
            if listed_files(folder) == [REPORT] and not any(folder in other.parents for other in below)
        ]
    return FoundResults(found, without)


def ending_of(to: str, sweep: bool, out: Path, results: dict[str, Path]) -> str:
    """How the file of each of the results ends in the folder `out`; "" where it is a folder.

    Raises
    ------
    InputError
        If there is no format `to`, or `out` is called like such a file.
    """
    ending = by_name("format", to, FORMATS) if to else FILM if sweep else PICTURE
    if ending and out.suffix.lower() == ending:
        raise InputError(
            f"--out {out} is called like one file but several results go into a folder; name one, or "
            f"give a result in it, such as {next(iter(results.values()))}."
        )
    return ending
