"""Folders of results: new, or ones that photonormal wrote, as their report says; nothing else in them is touched."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from photonormal.disk import PARTIAL, FileBatch, at_once, identities, refuse_folder, unwritable
from photonormal.types import InputError

REPORT = "report.json"
MARKER = {"written_by": "photonormal"}  # in the report of a result
LONGEST = 2**26  # bytes of a report
NAMES = (  # of the files of a result, of `measure`, `check` and `batch`
    *("normals.png", "normals.npz", "albedo.png", "depth.npz", "mesh.ply", "preview.png", "error.png"),
    *("expected-error.png", "thumbnail.png", "lights.png", "corrected.lp", "corrected.png"),
    *("base_colour.png", "roughness.png", "metalness.png", "specular.png", "material_known.png"),
    *("lights.lp", "light_intensities.txt", REPORT),
    *("sphere.lp", "sphere.json", "sphere_spheres.png"),  # of a calibration
    *("summary.csv", "summary.parquet", "index.html", "view.html"),  # of a batch
)


@contextmanager
def whole_folder(
    out: Path, overwrite: bool = False, reads: Iterable[Path | None] = (), wait_seconds: float = 0
) -> Iterator[FileBatch]:
    """A batch of files, of NAMES, that appear in `out` at once; the last one written is `report(batch, ...)`.

    A result in `out` that photonormal wrote goes when the new one comes: the files that its report lists, as long as
    they have the sizes that it lists. Nothing else is moved or removed. A folder that holds other things, or a file of
    NAMES that is not of that result, needs `overwrite`; then such a file is replaced.

    Parameters
    ----------
    reads : files and folders that the results are made from; nothing in them is ever replaced
    wait_seconds : for another process that writes there

    Raises
    ------
    InputError
        Before the block, where the results can't be written: `out` is a file, read-only, in use by another process,
        one of `reads`, or holds things that may not be replaced. After it, where they couldn't be.
    """
    used = identities(p for p in reads if p is not None)
    try:
        _refuse(out, overwrite, used)
    except OSError as error:
        raise unwritable(out, error) from None
    with at_once(out, wait_seconds) as batch:
        _replaced(out, NAMES, overwrite, used)  # once more, after a killed run has been cleared up
        yield batch
        batch.remove = _replaced(out, batch.names, overwrite, used)


def report(batch: FileBatch, content: dict[str, Any]) -> dict[str, Any]:
    """Write a result's report: the content, the marker, and the files written so far with their sizes; returns it."""
    content = content | MARKER | {"files": batch.sizes()}
    batch.write(REPORT, as_json(content))
    return content


def as_json(content: Any) -> bytes:
    """UTF-8; bytes of file names that are none are escaped, so that reading it gives the same names."""
    text = json.dumps(content, indent=2, ensure_ascii=False, default=_plain) + "\n"
    return text.encode("utf-8", "backslashreplace")


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _refuse(out: Path, overwrite: bool, used: set[tuple[int, int]]) -> None:
    if out.is_symlink() and not out.exists():
        raise InputError(f"{out} is a link to nothing but a folder for the results is needed; choose another --out.")
    if os.path.lexists(out) and not out.is_dir():
        raise InputError(f"{out} is a file but a folder for the results is needed; choose another --out.")
    if not out.is_dir():
        return
    if identities([out]) & used:
        raise InputError(
            f"{out} holds the photographs, and results would be taken for more of them; choose another --out, "
            f"such as {out / 'result'}."
        )
    _replaced(out, NAMES, overwrite, used)
    others = {p.name for p in out.iterdir()} - {PARTIAL}
    if others and not overwrite and listed_files(out) is None:
        raise InputError(
            f"{out} exists and holds no photonormal result; choose another --out, or add --overwrite to put the "
            "results beside what is there."
        )


def _replaced(out: Path, names: Iterable[str], overwrite: bool, used: set[tuple[int, int]]) -> list[str]:
    """The files of `out` that go when a result with files `names` comes; InputError where one of them may not."""
    ours = listed_files(out) or []
    for name in dict.fromkeys([*names, *ours]):
        path = out / name
        refuse_folder(path)
        if not os.path.lexists(path):
            continue
        above = Path(os.path.realpath(path)).parents
        if identities([path]) & used or (name not in ours and identities(above) & used):
            raise InputError(
                f"{path} is among the files that are read here, and is not written over; choose another --out."
            )
        if name not in ours and not overwrite:
            raise InputError(
                f"{path} was not written by photonormal, or has changed since; choose another --out, or add "
                "--overwrite to replace it."
            )
    return ours


def listed_files(out: Path) -> list[str] | None:
    """Files of the result in a folder, as its report says, its report first; None where there is no result of ours."""
    if not 0 < (_size(out / REPORT) or 0) < LONGEST:
        return None
    try:
        content = json.loads((out / REPORT).read_bytes())
        files = content["files"]
        if content | MARKER != content or not isinstance(files, dict):
            return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return [REPORT, *(n for n, size in files.items() if n in NAMES and n != REPORT and _size(out / n) == size)]


def result_files(folder: Path) -> list[Path]:
    """The files of the result in a folder, which nothing else is written over; none where there is no result."""
    return [folder / name for name in listed_files(folder) or []]


def reported_below(folder: Path) -> list[Path]:
    """The folders below one that hold a report, of a result or of a capture that failed; hidden ones are left out."""
    found = sorted(p.parent for p in folder.glob("*/**/" + REPORT)) if os.path.isdir(folder) else []
    return [p for p in found if not any(part.startswith(".") for part in p.relative_to(folder).parts)]


def _size(path: Path) -> int | None:
    return path.stat().st_size if path.is_file() and not path.is_symlink() else None
