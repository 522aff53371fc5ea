"""What a result depends on: the version, the method with its options, weights and code, and the files that were read.

It stands in a result's report, so that a later run can see whether the same would come out again.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, NotRequired, TypedDict

import photonormal
from photonormal.files.decode import SUFFIXES
from photonormal.files.opening import Opened, Stamp, open_file
from photonormal.methods import configure, options_of
from photonormal.options import LightsFrom
from photonormal.stored import Word
from photonormal.types import InputError

PACKAGE = Path(__file__).parent
IMPORTS = re.compile(r"^ *(?:from|import) (photonormal[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)
PARTS = {".py", ".json", ".safetensors"}  # of the package that results depend on
ENGINE = tuple(f"photonormal.methods.engine.{part}" for part in ("samples", "stream", "halved", "near"))
FINDING = {  # where lights come from -> what finds them
    "refined": "photonormal.methods.uncalibrated.refine",
    "unknown": "photonormal.methods.uncalibrated.unknown",
}
BESIDES = {"photonormal", "photonormal.methods", "photonormal.types", "photonormal.options"}  # names and checks
COMPARED = {  # what a result is made by -> how a change of it is named
    "photonormal": "version",
    "method": "method",
    "options": "options",
    "precision": "precision",
    "srgb": "srgb",
    "weights_sha256": "other weights",
    "source_sha256": "other code of the method",
    "lights_sha256": "other weights of the network that finds lights",
}


class Input(TypedDict):
    """A file that was read."""

    bytes: int
    mtime_ns: int
    sha256: Word


class Inputs(TypedDict):
    """All that was read of a capture."""

    files: dict[Word, Input]  # by paths, relative where they lie below the capture's folder
    beside: list[Word]  # files that were not read and may matter


class ProgramVersion(NamedTuple):
    """Which photonormal this is, whatever its method."""

    version: str
    sha256: str  # of its code and weights


class Made(TypedDict):
    """What a result is made by."""

    photonormal: Word
    method: Word
    options: dict[str, Any]
    weights_sha256: Word | None
    source_sha256: Word
    precision: NotRequired[Word]
    lights_sha256: NotRequired[Word]  # where the lights were found by the package's network


def made_by(method: str, options: Mapping[str, Any], lights: LightsFrom = "given") -> Made:
    """This version, a method with all its options, and digests of its weights and code, and of what finds the lights.

    Raises
    ------
    InputError
        If there is no such method or option, or its weights can't be read.
    """
    solver = configure(method, **options)
    try:
        weights = getattr(solver, "weights_sha256", None)
    except OSError as error:
        raise InputError(f"weights {error.filename} can't be read; train or install them first.") from None
    finding = None if solver.needs.finds_lights else FINDING.get(lights)
    made: Made = {
        "photonormal": photonormal.__version__,
        "method": method,
        "options": options_of(solver),
        "weights_sha256": weights,
        "source_sha256": source_sha256(type(solver).__module__, *([finding] if finding else [])),
    }
    if finding and lights == "unknown":
        from photonormal.methods.learned.weights import LIGHTS, checksum, shipped

        made["lights_sha256"] = checksum(shipped(LIGHTS))
    return made


def change(before: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[str, str] | None:
    """The first of COMPARED in which two results differ, and what to say of it; None where they agree."""
    for key, what in COMPARED.items():
        default = {"precision": "auto", "srgb": False}.get(key)
        if before.get(key, default) != now.get(key, default):
            return key, what if key.endswith(
                "sha256"
            ) else f"{what} {before.get(key, default)}, not {now.get(key, default)}"
    return None


def names_beside(capture: Path) -> set[str]:
    """The files in a capture's folder; of a list's, which others may share, none that are lists or photographs."""
    of_list = capture.is_file()
    try:
        found = [p for p in folder_of(capture).iterdir() if not p.name.startswith(".") and p.is_file()]
    except OSError:
        return set()
    others = [p for p in found if of_list and (p.suffix.lower() == ".lp" or _photograph(p))]
    return {p.name for p in found} - {p.name for p in others}


def _photograph(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and "mask" not in path.stem.lower()


def inputs(capture: Path, read: Mapping[Path, Opened], names: Callable[[Path], set[str]] = names_beside) -> Inputs:
    """What was read of a capture, by the files that were opened. Only what was not read to its end is read now.

    `names` gives the files of a capture that may matter; by default it is `names_beside`.

    Raises
    ------
    InputError
        If one of them has changed since, or is gone.
    """
    folder = folder_of(capture).resolve()
    files: dict[str, Input] = {}
    for path, (stamp, digest) in sorted(read.items()):
        try:
            digest = digest or _digest(path)
            now = Stamp.of(path.stat())
        except OSError:
            raise InputError(
                f"{path} is gone; it was there when the measurement began. Put it back and measure again."
            ) from None
        if now != stamp:
            raise InputError(f"{path} has changed while it was read; wait until it is whole and measure again.")
        files[_name(path, folder)] = {"bytes": stamp.bytes, "mtime_ns": stamp.mtime_ns, "sha256": digest}
    return {"files": files, "beside": sorted(names(capture) - files.keys())}


def changed(capture: Path, before: Inputs, names: Callable[[Path], set[str]] = names_beside) -> str:
    """What is no longer as it was when a capture was read, in words; "" where all is. Only files whose time differs
    are read again. `names` as for `inputs`."""
    folder = folder_of(capture)
    for name, was in before["files"].items():
        path = folder / name
        try:
            status = path.stat()
            same = status.st_size == was["bytes"]
            if same and status.st_mtime_ns != was["mtime_ns"]:
                same = _digest(path) == was["sha256"]
        except (OSError, InputError):
            return f"{name} is gone"
        if not same:
            return f"{name} has changed"
    known = before["files"].keys() | set(before["beside"])
    now = names(capture)
    if come := sorted(now - known):
        return f"{come[0]} has come"
    gone = sorted(set(before["beside"]) - now)
    return f"{gone[0]} is gone" if gone else ""


def folder_of(capture: Path) -> Path:
    """The folder that a capture lies in: itself, or that of its list."""
    return capture if os.path.isdir(capture) else capture.parent


def _name(path: Path, folder: Path) -> str:
    path = path.resolve()
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def _digest(path: Path) -> str:
    """SHA-256 of a file."""
    with open_file(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


@cache
def program() -> ProgramVersion:
    """This photonormal, as its files were when this process first asked."""
    digest = hashlib.sha256()
    for path in sorted(p for p in PACKAGE.rglob("*") if p.suffix in PARTS):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + _content(path) + b"\0")
    return ProgramVersion(photonormal.__version__, digest.hexdigest())


def source_sha256(*modules: str) -> str:
    """SHA-256 of modules, such as a method's, of the engine, and of all modules of photonormal that they import."""
    found: dict[str, bytes] = {}
    waiting = [*modules, *ENGINE]
    while waiting:
        name = waiting.pop()
        file = _file(name)
        if file is None or name in found or name in BESIDES:
            continue
        found[name] = _content(file)
        waiting += _imports(found[name])
    digest = hashlib.sha256()
    for name in sorted(found):
        digest.update(name.encode() + b"\0" + found[name] + b"\0")
    return digest.hexdigest()


def _content(file: Path) -> bytes:
    """What a file of the package holds, the same whatever system it was checked out on."""
    data = file.read_bytes()
    return data.replace(b"\r\n", b"\n") if file.suffix in (".py", ".json") else data


def _imports(source: bytes) -> Iterable[str]:
    """The modules of photonormal, and the names in them, that a module imports anywhere."""
    for module, names in IMPORTS.findall(source.decode()):
        yield module
        yield from (f"{module}.{name}" for name in re.findall(r"[\w.]+", names))


def _file(module: str) -> Path | None:
    place = PACKAGE.joinpath(*module.split(".")[1:])
    return next((p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()), None)
