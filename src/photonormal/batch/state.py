"""How far a capture is, by the folder of its result: done, stale, failed or not begun. Nothing else keeps a record."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NotRequired, TypedDict

from photonormal.capture import place_of
from photonormal.capture.rti import named_pictures
from photonormal.disk import at_once, recover
from photonormal.export.folder import MARKER, REPORT, as_json, listed_files
from photonormal.files.opening import Opened
from photonormal.job import PROVENANCE, Job
from photonormal.provenance import Inputs, Made, change, changed, folder_of, inputs, names_beside
from photonormal.stored import read_json
from photonormal.types import InputError

FAILED = "failed"  # in a report
Kind = Literal["input", "fault", "killed"]  # it can't be used, the code is at fault, the machine was at its end


class Provenance(TypedDict):
    """All that a result depends on."""

    made: Made
    asked: dict[str, Any]
    inputs: Inputs


class Failure(TypedDict):
    """Why there is no result, or none of what is asked for now."""

    kind: Kind
    message: str
    provenance: Provenance | None


class Known(TypedDict):
    """What is read of a report; the rest of it may be anything."""

    files: dict[str, int]
    provenance: NotRequired[Provenance]
    failed: NotRequired[Failure]


@dataclass(frozen=True)
class CaptureState:
    """How far a capture is.

    Parameters
    ----------
    kind : "done"; "stale": there is a result, but of something else, `why`; "options": of other options, `why`;
        "failed": it can't be measured, `why`; "begin": there is nothing yet
    """

    kind: Literal["done", "stale", "options", "failed", "begin"]
    why: str = ""


def state_of(job: Job) -> CaptureState:
    """How far a capture is, by the report in the folder of its result and the files that it was made from."""
    if not os.path.isdir(job.out):
        return CaptureState("begin")
    recover(job.out)
    report, files = read_report(job.out), listed_files(job.out)
    if report is None or files is None:
        return CaptureState("begin")
    failure, made = report.get("failed"), report.get("provenance")
    if failure is not None:
        told = failure["provenance"]
        if failure["kind"] == "killed" or told is None or _difference(job, told, all_below) is not None:
            return CaptureState("begin")
        return CaptureState("failed", failure["message"])
    if made is None:
        return CaptureState("stale", "an earlier version made it")
    if len(files) < 1 + len(report["files"]):
        return CaptureState("stale", "files of it are gone or have changed")
    return _difference(job, made) or CaptureState("done")


def _difference(job: Job, before: Provenance, names: Callable[[Path], set[str]] = names_beside) -> CaptureState | None:
    """What would be different now; None: nothing. `names` are the files of a capture that were looked for."""
    found = change(before["made"], job.made())
    if found is not None:
        return CaptureState("options" if found[0] in ("method", "options") else "stale", found[1])
    was, now = before["asked"], job.asked()
    for key in sorted(was.keys() | now.keys()):
        if was.get(key) != now.get(key):
            option = key.replace("_", "-")
            given = f"{option} {was[key]}" if key in was else f"without {option}"
            return CaptureState("options", f"{given}, not {now[key]}" if key in now else f"{given}, which is not given")
    what = changed(place_of(job.capture), before["inputs"], names)
    return CaptureState("stale", what) if what else None


def read_report(folder: Path) -> Known | None:
    """What a folder's report says; None where it has none of ours."""
    if listed_files(folder) is None:
        return None
    try:
        return read_json(folder / REPORT, Known, "measure again")
    except InputError:
        return None


def record_failure(job: Job, kind: Kind, message: str, read: Mapping[Path, Opened] | None) -> None:
    """Tell in the report of a capture why it can't be measured; a result that is there stays.

    `read` are the files that were opened; None: not known.
    """
    try:
        origin = None
        if read is not None:
            origin = {"made": job.made(), "asked": job.asked(), "inputs": _inputs(job, read)}
        failure = {"kind": kind, "message": message, PROVENANCE: origin}
        ours = listed_files(job.out) is not None
        if not ours and job.out.is_dir() and any(p.name[0] != "." for p in job.out.iterdir()):
            return  # somebody else's folder: that is why
        before = read_json(job.out / REPORT, dict[str, Any], "measure again") if ours else {"files": {}}
        with at_once(job.out, wait_seconds=0) as batch:
            batch.write(REPORT, as_json(before | MARKER | {FAILED: failure}))
    except InputError:
        return  # it can't be written there: that is why


def _inputs(job: Job, read: Mapping[Path, Opened]) -> Inputs:
    found = {path: stamp for path, stamp in read.items() if path.is_file()}
    return inputs(place_of(job.capture), found, all_below)


def all_below(capture: Path) -> set[str]:
    """The files of a capture's folder and of all folders in it that are no results, and those anywhere that its list
    names: any may be what is missing."""
    folder, found = folder_of(capture), set()
    for place, folders, files in os.walk(folder):
        inside = Path(place)
        folders[:] = [name for name in folders if name[0] != "." and listed_files(inside / name) is None]
        found |= {(inside / name).relative_to(folder).as_posix() for name in files if name[0] != "."}
    if os.path.isfile(capture):  # which a name may be too long for
        with suppress(InputError):  # it is no list
            there, place = (p.resolve() for p in named_pictures(capture)), folder.resolve()
            found |= {str(picture) for picture in there if not picture.is_relative_to(place)}
    return found
