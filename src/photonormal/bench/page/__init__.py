"""A report in one HTML file: sortable tables, maps to compare, surfaces to turn. It opens without server or network."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from photonormal.bench.page.html import tables_html
from photonormal.bench.page.layers import COLOURS, LEVELS_PER_DEGREE, UNKNOWN, objects
from photonormal.bench.scores import all_scored
from photonormal.bench.tables import tables
from photonormal.disk import refuse_taken, write
from photonormal.progress import progress
from photonormal.types import InputError

HERE = Path(__file__).parent
PRELUDE = """"use strict";
window.addEventListener("error", (e) => { document.body.dataset.error = e.message; });
window.addEventListener("unhandledrejection", (e) => { document.body.dataset.error = String(e.reason); });
"""
LIMIT = 12  # objects of a dataset with maps, unless they are named


def report(
    runs: str | Path,
    out: str | Path,
    methods: Sequence[str] = (),
    datasets: Sequence[str] = (),
    shown: Sequence[str] = (),
    published: bool = True,
    surfaces: bool = True,
    overwrite: bool = False,
) -> Path:
    """Write the report of a folder of runs.

    Parameters
    ----------
    runs : the `out` of photonormal.bench.bench
    out : the file to write, .html
    methods, datasets : only these; all by default
    shown : objects to show maps of; by default up to LIMIT of each dataset, evenly picked
    published : add the published figures of methods that can't be run here
    surfaces : integrate the normals of each object's best method
    overwrite : replace a file that exists

    Raises
    ------
    InputError
        If there is nothing to show, a name is unknown, or `out` exists or can't be written.
    """
    runs, out = Path(runs), Path(out)
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out} ends in {out.suffix!r} but an .html file is written; choose such a name.")
    refuse_taken([out], overwrite)
    found = tables(runs, methods, datasets, published)
    whole = [s for s in all_scored(runs, methods, datasets) if s.prediction.protocol == "all"]
    names = {s.prediction.object for s in whole}
    for name in shown:
        if name not in names:
            raise InputError(f"{runs} holds no object {name!r}; it has {', '.join(sorted(names)[:20])}.")
    with progress("report", len(names)) as advance:
        data = {
            "colours": COLOURS(),
            "levels_per_degree": LEVELS_PER_DEGREE,
            "unknown": UNKNOWN,
            "objects": list(objects(runs, whole, shown, LIMIT, surfaces, advance)),
        }
    write(out, filled(tables_html(found), data).encode())
    return out


def filled(tables: str, data: dict[str, Any]) -> str:
    """The page: every mark of page.html is replaced once, so that what names contain is never taken for one."""
    style, script = _file("page.css"), PRELUDE + "".join(_file(f"{n}.js") for n in ("surface", "compare", "sort"))
    text = json.dumps(data, separators=(",", ":"))
    for character in "<>&":  # nothing ends the block, or begins another
        text = text.replace(character, f"\\u{ord(character):04x}")
    parts = {
        "policy": f"default-src 'none'; img-src data:; style-src '{_digest(style)}'; script-src '{_digest(script)}'; "
        "base-uri 'none'; form-action 'none'",
        "style": style,
        "tables": tables,
        "data": text,
        "script": script,
    }
    return re.sub("|".join(f"\\[\\[{name}\\]\\]" for name in parts), lambda m: parts[m[0][2:-2]], _file("page.html"))


def _file(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    """How a Content-Security-Policy names what may run."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
