"""The page of a batch: a row for each capture, with its thumbnail; sorted and filtered, what failed on top."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from photonormal.batch.row import CaptureRow
from photonormal.view.page import document, read

HERE = Path(__file__).parent
COLUMNS = (
    *("capture", "pictures", "expected error, deg", "error, deg", "findings", "pixels", "lights", "seconds"),
    *("memory, MB", "method"),
)
SHOWN = "normals, relit, expected error"  # on a thumbnail
WORST_DEG = 20.0  # expected error whose bar is full


def page(rows: Sequence[CaptureRow], title: str) -> bytes:
    """The whole page; pictures and files are those below its folder."""
    count = {kind: sum(kind in _kinds(row) for row in rows) for kind in ("failed", "grave", "note", "fine")}
    said = {"failed": "failed", "grave": "with grave findings", "note": "with notes", "fine": "without findings"}
    buttons = "".join(
        f'<button type="button" data-kind="{kind}" aria-pressed="false">{count[kind]} {words}</button>'
        for kind, words in said.items()
    )
    parts = {
        "title": escape(title),
        "count": f"{len(rows)} capture{'s' * (len(rows) != 1)}",
        "buttons": buttons,
        "failures": _failures(rows),
        "head": "".join(f'<th scope="col"><button type="button">{c}</button></th>' for c in COLUMNS),
        "rows": "\n".join(map(_row, rows)),
    }
    body = re.sub(r"\[\[(\w+)\]\]", lambda place: parts[place[1]], (HERE / "page.html").read_text(encoding="utf-8"))
    scripts = [(HERE / "filter.js").read_text(encoding="utf-8"), read("sort.js")]
    style = (HERE / "page.css").read_text(encoding="utf-8")
    return document(f"{title} - photonormal", body, [style], scripts, None, beside=True)


def _kinds(row: CaptureRow) -> list[str]:
    """What the buttons find a row by."""
    if row.state != "done":
        return ["failed"] if row.state == "failed" else []
    return ["grave"] if row.grave else ["note"] if row.findings else ["fine"]


def _failures(rows: Sequence[CaptureRow]) -> str:
    failed = [row for row in rows if row.state == "failed"]
    if not failed:
        return ""
    lines = "".join(f"<li><b>{escape(row.capture)}</b>: {escape(row.failure)}</li>" for row in failed)
    return f'<section id="failures"><h2>{len(failed)} failed</h2><ul>{lines}</ul></section>'


def _row(row: CaptureRow) -> str:
    folder = quote(os.fsencode(row.capture))
    kinds = " ".join(_kinds(row))
    made = row.pixels is not None
    files = {"preview": "preview.png", "normals": "normals.png", "report": "report.json", "files": ""} if made else {}
    links = " ".join(f'<a href="{folder}/{file}">{name}</a>' for name, file in files.items())
    image = f'<img loading="lazy" src="{folder}/thumbnail.png" alt="{SHOWN}">'
    opened = quote(os.fsencode(row.page)) if row.page else f"{folder}/preview.png" if made else f"{folder}/"
    picture = f'<a href="{opened}">{image}</a>' if made else ""
    cells = [
        f'<th scope="row"><a href="{opened}">{_name(row.capture)}</a><small>{links}</small></th>',
        f"<td>{picture}</td>",
        _degrees(row.expected_error_deg),
        _number(row.error_deg, 2),
        _findings(row),
        *(_number(v, 0) for v in (row.pixels, row.lights)),
        _number(row.seconds, 1),
        _number(row.memory_mb, 0),
        f"<td>{escape(row.method)}</td>",
    ]
    return f'<tr data-kind="{kinds}">{"".join(cells)}</tr>'


def _name(capture: str) -> str:
    """A name that may go on in the next line after a slash, an underscore or a point."""
    return re.sub(r"([/_.])", r"\1<wbr>", escape(capture))


def _degrees(value: float | None) -> str:
    """An expected error, with a bar."""
    if value is None:
        return "<td></td>"
    bar = f'<meter max="{WORST_DEG}" low="5" high="10" optimum="0" value="{min(WORST_DEG, value):.3f}"></meter>'
    return f'<td data-value="{value}">{value:.2f}{bar}</td>'


def _number(value: float | None, digits: int) -> str:
    return "<td></td>" if value is None else f'<td data-value="{value}">{value:.{digits}f}</td>'


def _findings(row: CaptureRow) -> str:
    """How many, in colours, and what they say; in place of them that it failed, and why."""
    if row.state == "failed":
        reason = f'<details><summary><span class="failed">failed</span></summary>{escape(row.failure)}</details>'
        return f'<td data-value="1e9" class="text">{reason}</td>'
    if row.state != "done":
        return '<td class="text">not begun</td>'
    grave, notes = row.grave or 0, (row.findings or 0) - (row.grave or 0)
    marks = [f'<span class="grave">{grave} grave</span>'] * bool(grave)
    marks += [f'<span class="note">{notes} note{"s" * (notes > 1)}</span>'] * bool(notes)
    words = f"<details><summary>{' '.join(marks)}</summary>{escape(row.warnings)}</details>" if marks else ""
    return f'<td data-value="{1000 * grave + notes}" class="text">{words or escape(row.warnings)}</td>'
