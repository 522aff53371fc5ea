"""What is read before a result is handed on, and where it may be written to."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from photonormal.capture import files_read
from photonormal.disk import refuse_filled, refuse_taken
from photonormal.export import load_normals
from photonormal.export.folder import result_files
from photonormal.files.opening import read_npz
from photonormal.handover import FORMATS
from photonormal.methods.engine.near import seen_as_distant
from photonormal.types import Capture, InputError, by_name
from photonormal.view.result import photographs_of, report_of


def refuse(kind: str, result: Path, out: Path, overwrite: bool, reads: Iterable[Path] = ()) -> None:
    """InputError where there is no such format, the file's ending is another's, or `out` can't be written: it is the
    result, or a file of it, or one of the files that are read."""
    ending, files = by_name("format", kind, FORMATS), result_files(result)
    if not ending:
        return refuse_filled(out, overwrite, [result, *files, *reads])
    if out.suffix.lower() != ending:
        raise InputError(f"--out {out} ends in {out.suffix!r} but {kind} is a {ending} file; choose such a name.")
    refuse_taken([out], overwrite, reads, files)


def photographs_needed(result: Path, given: Path | None, what: str, otherwise: str = "") -> tuple[Capture, list[Path]]:
    """The photographs of a result as distant lights would have shown them, and the files that they come from.

    Parameters
    ----------
    given : where they are, if not where the report says
    what : begins the sentence of what is fitted to them
    otherwise : what else can be done without them

    Raises
    ------
    InputError
        If the folder holds no result, or the photographs are not there: it says where they were.
    """
    report = report_of(result)
    mask = read_npz(result / "normals.npz", "measure again", ("mask",)).get("mask")
    if mask is None:
        raise InputError(f"{result / 'normals.npz'} holds no mask; measure again.")
    found, missing = photographs_of(report, result, given, mask.shape)
    if found is None:
        said = f"{(missing or '').removesuffix('.')}, {otherwise}." if otherwise else missing
        raise InputError(f"{what} fitted to the photographs of {result}. {said}")
    distant = found if found.lamps is None else seen_as_distant(found, load_normals(result))
    return distant, files_read(given or report.get("source", ""), found)
