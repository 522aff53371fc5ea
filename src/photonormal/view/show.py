"""The page that shows results: served, or as one file."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from photonormal.capture.images import MARGIN
from photonormal.capture.pictures import evenly
from photonormal.disk import refuse_taken, write
from photonormal.export.folder import result_files
from photonormal.export.result import brightest
from photonormal.geometry import far_apart
from photonormal.masked import box_of
from photonormal.types import InputError, Result
from photonormal.view.page import document, ramp, read
from photonormal.view.planes import SIDE, units
from photonormal.view.result import ViewedResult, open_result, shown_of

SCRIPTS = (
    *("base", "source", "gl", "shading", "tiles", "picture", "surface", "light", "measure"),
    *("view", "labels", "input", "pointer", "plain"),
)
FILE_PIXELS = 6e6  # of a result inside one file; larger ones are reduced
SMALL_PIXELS = 1e6  # inside a page of a batch
PHOTOGRAPHS = 12  # inside one file
PHOTOGRAPH_SIDE = 1024  # pixels of the longest side of them


def result_page(results: Sequence[dict[str, Any]], tiles: dict[str, str] | None = None) -> bytes:
    """The page of the results that the dictionaries describe; without `tiles` it asks for them where it came from."""
    data = {"results": list(results), "tiles": tiles, "colours": ramp(), **units()}
    title = ", ".join(r["title"] for r in results)
    scripts = [read(f"{name}.js") for name in SCRIPTS]
    return document(
        f"{title} - photonormal", read("view.html"), [read("view.css")], scripts, data, served=tiles is None
    )


def marking_page(about: dict[str, Any]) -> bytes:
    """The page that marks the photographs that the dictionary describes."""
    scripts = [read(f"{name}.js") for name in ("base", "source", "gl", "tiles", "light", "brush", "mark", "marking")]
    data = {"tiles": None, **about}
    styles = [read("view.css"), read("mark.css")]
    return document(f"{about['title']} - photonormal", read("mark.html"), styles, scripts, data, served=True)


def export_page(
    folder: str | Path,
    out: str | Path,
    capture: str | Path | None = None,
    mm_per_px: float | None = None,
    overwrite: bool = False,
) -> tuple[Path, int]:
    """Write the page of one result as one file, which opens without server or network.

    Results above FILE_PIXELS are halved until they fit; up to PHOTOGRAPHS photographs go in, with lights far apart.

    Parameters
    ----------
    folder, capture, mm_per_px : as for `photonormal.view.result.open_result`
    out : the file to write, .html
    overwrite : replace a file that exists

    Returns
    -------
    The file written, and by how much the result was reduced: 1 for not at all.
    """
    out = Path(out)
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--page {out} ends in {out.suffix!r} but an .html file is written; choose such a name.")
    refuse_taken([out], overwrite, of_result=result_files(Path(folder)), option="--page")
    shown = open_result(folder, capture, mm_per_px)
    about = dict(shown.about)
    sizes = about["sizes"]
    about["first"] = next(k for k, (w, h) in enumerate(sizes) if w * h <= FILE_PIXELS)
    about["first_photograph"] = next(k for k, size in enumerate(sizes) if max(size) <= max(PHOTOGRAPH_SIDE, SIDE))
    about["photographs"] = some_photographs(about["photographs"], PHOTOGRAPHS)
    reduced = 2 ** about["first"]
    if reduced > 1:
        about["notes"] = [
            *about["notes"],
            f"This file holds the result at 1/{reduced} of its size; `photonormal view` shows all of it.",
        ]
    write(out, _one_file(shown, about))
    return out, reduced


def small_page(result: Result, name: str) -> bytes:
    """The page of a result that is not written yet, as one small file: without photographs, and of a result above
    SMALL_PIXELS some rows and columns only."""
    rows, columns = (s.stop - s.start for s in box_of(result.normals.mask, MARGIN))
    every = math.ceil(math.sqrt(rows * columns / SMALL_PIXELS))
    capture, white = result.capture, brightest(result)
    unit = None if capture.camera is None else capture.camera.mm_per_px
    maps = result.normals, result.albedo, result.surface, capture.truth
    shown = shown_of(name, *maps, result.report, unit, white, every)
    part = "" if every == 1 else f"one of {every} rows and columns of "
    shown.about["notes"].append(f"This file holds {part}the result without photographs; `photonormal view` shows all.")
    return _one_file(shown, shown.about)


def some_photographs(photographs: list[dict[str, Any]], limit: int) -> list[dict[str, Any]]:
    """At most `limit` of the photographs, in their order: those whose lights lie far apart, where lights are known."""
    if len(photographs) <= limit or photographs[0]["light"] is None:
        return evenly(photographs, limit)
    return [photographs[j] for j in sorted(far_apart(np.array([p["light"] for p in photographs]), limit))]


def _one_file(shown: ViewedResult, about: dict[str, Any]) -> bytes:
    tiles = {f"tile/0/{path}": base64.b64encode(tile).decode() for path, tile in _tiles(shown, about)}
    return result_page([about], tiles)


def _tiles(shown: ViewedResult, about: dict[str, Any]) -> Iterator[tuple[str, bytes]]:
    layers = [(name, about["first"]) for name in about["layers"]]
    layers += [(f"photograph-{p['index']}", about["first_photograph"]) for p in about["photographs"]]
    for layer, first in layers:
        for level, (w, h) in enumerate(about["sizes"]):
            for y in range(-(-h // SIDE) if level >= first else 0):
                for x in range(-(-w // SIDE)):
                    yield f"{layer}/{level}/{x}/{y}", shown.tile(layer, level, x, y)
