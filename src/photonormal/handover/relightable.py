"""A result's photographs -> a picture that viewers of RTI relight."""

from __future__ import annotations

from pathlib import Path

from photonormal.disk import at_once
from photonormal.handover.opened import photographs_needed, refuse
from photonormal.relighting import FORMATS, files, web


def export_relighting(
    result: Path,
    kind: str,
    out: Path,
    capture: Path | None = None,
    overwrite: bool = False,
    webp: bool = False,
) -> Path:
    """Write a relightable picture of a result's photographs, which the fit is made from; whole or not at all.

    Parameters
    ----------
    result : a folder that `measure` wrote
    kind : a key of photonormal.relighting.FORMATS
    out : the file or the folder to write
    capture : the photographs, where they are not where the report says
    overwrite : replace a file that exists, or write into a folder that holds others
    webp : see `photonormal.relighting.web.write`

    Raises
    ------
    InputError
        If the format or the folder is none, or the photographs are not there.
    """
    refuse(kind, result, out, overwrite)
    photographs, read = photographs_needed(result, capture, f"{kind} is")
    refuse(kind, result, out, overwrite, read)
    if FORMATS[kind].ending:
        with at_once(out.parent) as batch:
            files.write(photographs, kind, batch / out.name)
    else:
        with at_once(out) as batch:
            web.write(photographs, kind, batch, webp)
    return out
