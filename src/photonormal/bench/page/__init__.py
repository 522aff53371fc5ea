"""A report in one HTML file: sortable tables, maps to compare, surfaces to turn. It opens without server or network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from photonormal.bench.page.html import tables_html
from photonormal.bench.page.layers import objects
from photonormal.bench.scores import all_scored
from photonormal.bench.tables import tables
from photonormal.disk import refuse_taken, write
from photonormal.progress import progress
from photonormal.types import InputError
from photonormal.view.page import document, ramp, read
from photonormal.view.planes import units

HERE = Path(__file__).parent
LIMIT = 12  # objects of a dataset with maps, unless they are named


def write_page(
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
            "colours": ramp(),
            **units(),
            "objects": list(objects(runs, whole, shown, LIMIT, surfaces, advance)),
        }
    shared = [read(f"{name}.js") for name in ("base", "gl", "shading", "tiles", "picture", "surface")]
    own = [*(_file(f"{name}.js") for name in ("relief", "compare")), read("sort.js")]
    body = _file("page.html").replace("[[tables]]", tables_html(found))
    write(out, document("photonormal benchmark", body, [_file("page.css")], shared + own, data))
    return out


def _file(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
