"""Which captures a batch measures: what patterns and lists of files name, and what each is called."""

from __future__ import annotations

import glob
import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from photonormal.capture import UNKNOWN
from photonormal.capture.pictures import natural
from photonormal.capture.texts import beside, read_lines, spellings
from photonormal.files.opening import read_bytes
from photonormal.job import Job
from photonormal.options import check_value
from photonormal.types import InputError, a_few

LISTS = {".csv", ".toml"}
LONGEST = 2**26  # bytes of a list
OWN = {"capture", "name"}  # columns of a list that are no options
NAME = r"(?!.*(^|/)\.)[^\\/\x00-\x1f]+(/[^\\/\x00-\x1f]+)*"
NAME_BYTES = 255  # bytes of each part of a name that disks take


@dataclass(frozen=True)
class Named:
    """A capture and what it is called: the folder of its result, below that of the batch."""

    name: str
    job: Job


class GivenCapture(NamedTuple):
    """A capture as a list names it, with options of its own, whose paths are relative to `base`; or as a pattern does,
    which has none."""

    path: Path
    name: str = ""
    options: dict[str, Any] | None = None
    base: Path = Path()


class FoundCaptures(NamedTuple):
    """What is to be measured, in the order of the names, and files among it that are no captures."""

    captures: list[Named]
    left_out: list[Path]


def jobs(captures: Sequence[str], out: Path, like: Job, kinds: Mapping[str, Any]) -> FoundCaptures:
    """The captures that patterns, folders, `.lp` files and lists name.

    Parameters
    ----------
    captures : patterns like "season/*", folders, `.lp` files, and lists (.csv, .toml) with a capture in each row and
        options of its own
    out : folder of the results; what lies in it is no capture
    like : how all are measured
    kinds : options that a list may give, by name, and their kinds

    Raises
    ------
    InputError
        If a pattern matches nothing, a list can't be used, or two captures have one name.
    """
    found, fixed, left_out = _found(captures, [p for p in (out, like.sphere) if str(p)], kinds)
    if not found:
        what = f"{left_out[0]} is a file" if left_out else f"{captures[0] if captures else 'nothing'} came"
        raise InputError(
            f"{what} but folders, .lp files or a list of captures are needed, elsewhere than in {out}; give some."
        )
    base = Path(os.path.commonpath([os.path.abspath(p) for p in fixed])) if fixed else Path()
    chosen: dict[str, GivenCapture] = {}
    for given in found:
        name = (
            given.name
            or Path(os.path.abspath(given.path)).relative_to(base).with_suffix(_ending(given.path)).as_posix()
        )
        before = chosen.get(name, given)
        if before.path != given.path:
            raise InputError(f"{before.path} and {given.path} would both be called {name}; give them names in a list.")
        if None not in (before.options, given.options) and before.options != given.options:
            raise InputError(
                f"{given.path} is listed twice with different options, and would be called {name} both times; give "
                "each row a `name` of its own."
            )
        chosen[name] = before if given.options is None else given
    for name in chosen:
        if inside := next((p.as_posix() for p in Path(name).parents if p.as_posix() in chosen), None):
            raise InputError(f"{name} lies in {inside}, which is a capture, too; match one of them.")
    made = (
        Named(name, _with(replace(like, capture=given.path, out=out / name), given.options or {}).located(given.base))
        for name, given in chosen.items()
    )
    return FoundCaptures(sorted(made, key=lambda named: natural(named.name)), left_out)


def _found(
    captures: Sequence[str], others: Sequence[Path | str], kinds: Mapping[str, Any]
) -> tuple[list[GivenCapture], list[Path], list[Path]]:
    """Captures, the folders that names are below, and files that are no captures. What lies in `others` is none,
    either."""
    found, fixed, left_out = [], [], []
    for text in captures:
        path = Path(text)
        if path.suffix.lower() in LISTS and path.is_file():
            found += _listed(path, kinds)
            continue
        there = os.path.lexists(path)
        for match in [path] if there else _matched(text):
            if any(Path(os.path.abspath(match)).is_relative_to(os.path.abspath(other)) for other in others):
                continue
            if not there and os.path.abspath(match) == os.path.abspath(_fixed(text)):  # as ** matches it, too
                continue
            if match.is_file() and match.suffix.lower() != ".lp":
                left_out.append(match)
                continue
            fixed.append(Path(os.path.abspath(path)).parent if there else _fixed(text))
            found.append(GivenCapture(match))
    return found, fixed, left_out


def _ending(path: Path) -> str:
    """What a name keeps of a path's suffix: all, unless it is a list of lights."""
    return "" if path.suffix.lower() == ".lp" and path.is_file() else path.suffix


def _fixed(pattern: str) -> Path:
    """The part of a pattern before its first wildcard."""
    parts = Path(pattern).parts
    wild = next((k for k, part in enumerate(parts) if glob.has_magic(part)), len(parts) - 1)
    return Path(*parts[:wild])


def _matched(pattern: str) -> list[Path]:
    """What a pattern matches; InputError, which says what lies there, if that is nothing."""
    matched = [Path(p) for p in sorted(glob.glob(pattern, recursive=True))]
    if not matched:
        place = _fixed(pattern)
        there = sorted(p.name + "/" * p.is_dir() for p in place.iterdir()) if place.is_dir() else []
        lies = f"{place} holds {a_few(there, 8) or 'nothing'}" if place.is_dir() else f"{place} does not exist"
        raise InputError(
            f"no capture matches {pattern}: folders and .lp files were looked for, but {lies}; correct it."
        )
    return matched


def _listed(path: Path, kinds: Mapping[str, Any]) -> Iterable[GivenCapture]:
    """The captures of a list; paths in it are relative to it."""
    rows = _toml(path) if path.suffix.lower() == ".toml" else _csv(path)
    if not rows:
        raise InputError(f"{path} lists no captures; give one in each row, under `capture`.")
    for number, row in enumerate(rows, 1):
        where = f"{path}, capture {number}"
        if not isinstance(row.get("capture"), str) or not row["capture"]:
            raise InputError(f"{where} has no `capture` but the path of a folder or an .lp file is needed; add it.")
        capture = beside(path.parent, row["capture"])
        name = spellings(str(row.get("name") or ""))[-1] or capture.name
        if not re.fullmatch(NAME, name) or any(len(os.fsencode(part)) > NAME_BYTES for part in name.split("/")):
            raise InputError(
                f"{where} is called {name[:60]!r} but a name for its folder of results is needed, of at most "
                f"{NAME_BYTES} bytes; give one."
            )
        options = {}
        for key, value in row.items():
            option = key.replace("-", "_")
            if option in OWN or value in ("", None):
                continue
            if option not in kinds:
                raise InputError(
                    f"{where} has the option {key[:40]!r}, which there is not; see `photonormal measure --help`."
                )
            options[option] = _value(value, kinds[option], f"{where}: {key}", path.parent)
        yield GivenCapture(capture, name, options, path.parent)


def _value(value: Any, kind: Any, called: str, base: Path) -> Any:
    """A value of a list, of its option's kind."""

    def of_path(wanted: type, given: Any) -> Any:
        if wanted is Path and isinstance(given, str):
            return UNKNOWN if given == str(UNKNOWN) else base / given
        raise NotImplementedError

    made = value
    pointed = value.replace(",", ".") if isinstance(value, str) and re.fullmatch(r"-?\d+,\d+", value) else value
    for given in (pointed, value):  # what holds, such as `1,2` as text, holds in the end
        with suppress(msgspec.ValidationError, NotImplementedError):
            made = msgspec.convert(given, kind, strict=False, dec_hook=of_path)
    check_value(made, kind, called)
    return made


def _toml(path: Path) -> list[dict[str, Any]]:
    try:
        content = tomllib.loads(read_bytes(path, "a list of captures", LONGEST).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is no TOML ({str(error).splitlines()[0]}); correct it.") from None
    rows = content.get("capture")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise InputError(f"{path} has no [[capture]] but one for each capture is needed, with capture = its path.")
    return rows


def _csv(path: Path) -> list[dict[str, Any]]:
    import csv

    lines = read_lines(path)
    separator = next((mark for mark in ";\t" if lines and mark in lines[0]), ",")
    head, *rows = list(csv.reader(lines, delimiter=separator, skipinitialspace=True)) or [[]]
    names = [name.strip().lower() for name in head]
    if not rows or "capture" not in names:
        raise InputError(f"{path} has no column `capture` but the captures' paths are needed there; add it.")
    filled = [[value.strip() for value in row] for row in rows if any(map(str.strip, row))]
    for row in filled:
        if more := [value for name, value in zip_longest(names, row, fillvalue="") if value and not name]:
            raise InputError(
                f"{path} has {more[0][:60]!r} in the row of {row[0][:60]!r}, beyond its columns; put what holds a "
                f"{separator} in quotes, or name the column."
            )
    return [dict(zip(names, row, strict=False)) for row in filled]


def _with(job: Job, options: dict[str, Any]) -> Job:
    """The job with options of its own."""
    if options.get("mesh") is False:
        options = options | {"integration": None}
    own = {f.name for f in fields(Job)} & options.keys()
    reading = {k: v for k, v in options.items() if k not in own | {"mesh"}}
    return replace(job, **{k: options[k] for k in own}, reading=job.reading | reading)
