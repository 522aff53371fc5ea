"""A result folder and its photographs -> files of other programs."""

from __future__ import annotations

from pathlib import Path

from photonormal.capture import files_read
from photonormal.disk import at_once, refuse_taken
from photonormal.export import load_normals
from photonormal.relighting import files
from photonormal.types import InputError
from photonormal.view.result import photographs_of, report_of


def export_relighting(
    result: Path, kind: str, out: Path, capture: Path | None = None, overwrite: bool = False, memory: str = ""
) -> Path:
    """Write a relightable picture of a result's photographs, which the fit is made from; whole or not at all.

    Parameters
    ----------
    result : a folder that `measure` wrote
    kind : a key of photonormal.relighting.FORMATS
    out : the file to write, .ptm or .rti
    capture : the photographs, where they are not where the report says
    overwrite : replace a file that exists
    memory : how much may be used, such as "3GB"

    Raises
    ------
    InputError
        If the format or the folder is none, or the photographs are not there.
    """
    from photonormal.files.memory import allow
    from photonormal.methods.engine.near import seen_as_distant

    allow(memory)
    files.check(kind, out)
    refuse_taken([out], overwrite)
    report = report_of(result)
    normals = load_normals(result)
    photographs, missing = photographs_of(report, capture, normals.mask.shape)
    if photographs is None:
        where = f" They were in {report['source']}." if "source" in report else ""
        raise InputError(f"{kind} is fitted to the photographs of {result}, which are not there.{where} {missing}")
    refuse_taken([out], overwrite, files_read(capture or report.get("source", ""), photographs))
    with at_once(out.parent) as batch:
        files.write(seen_as_distant(photographs, normals), kind, batch / out.name)
    return out
