"""Tables as HTML whose columns can be sorted."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from photonormal.bench.formats import costs, heading, notes, published_rows, set_against, shortfall
from photonormal.bench.tables import ErrorTable, MethodRow


def tables_html(tables: Sequence[ErrorTable]) -> str:
    """One section for each table."""
    return "\n".join(_section(t) for t in tables)


def _section(table: ErrorTable) -> str:
    parts = [f"<section><h2>{escape(table.title)}</h2>"]
    if table.columns:
        small = " Small: as published, and ours less theirs." if any(r.sources for r in table.rows) else ""
        parts.append(f"<p>Mean angular error in degrees.{small}</p>")
        head = ["method", *(heading(table, c) for c in table.columns)]
        parts.append(_table(head, [_cells(r, table) for r in table.rows]))
    else:
        parts.append("<p>There are no true normals: nothing to score.</p>")
    parts.append("<details open><summary>Seconds for one object and peak memory, measured in the same run</summary>")
    head = ["method", "read, s", "solve, s", "peak memory, MB", "GPU memory, MB", "on"]
    rows = [
        [_th(r.label), *(_number(t) for t in costs(r)[:-1]), f"<td>{escape(r.cost.machine)}</td>"] for r in table.rows
    ]
    parts += [_table(head, rows), "</details>"]
    if table.only_published:
        head, published = published_rows(table)
        rows = [[_th(name), *(_number(v) for v in values)] for name, *values in published]
        parts.append("<details><summary>Published by others, not measured here</summary>")
        parts += [_table(head, rows), "</details>"]
    parts.append("<details><summary>Sources and remarks</summary><ul>")
    parts += [f"<li>{escape(note)}</li>" for note in notes(table)]
    parts.append("</ul></details></section>")
    return "\n".join(parts)


def _cells(row: MethodRow, table: ErrorTable) -> list[str]:
    found = [_th(row.label)]
    for column in table.columns:
        cell = row.cells.get(column.name)
        if cell is None:
            found.append("<td></td>")
            continue
        text = f"{cell.value:.2f}" + ("" if cell.spread is None else f" ± {cell.spread:.2f}")
        rank = table.rank(column).get(row.label, 0)
        text = {1: f"<b>{text}</b>", 2: f"<u>{text}</u>"}.get(rank, text)
        text += shortfall(row, table, column)
        small = f"<small>{set_against(cell)}</small>" if cell.published is not None else ""
        found.append(f'<td data-value="{cell.value:.6f}">{text}{small}</td>')
    return found


def _table(head: list[str], rows: list[list[str]]) -> str:
    names = "".join(f'<th scope="col"><button type="button">{escape(h)}</button></th>' for h in head)
    body = "\n".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{names}</tr></thead><tbody>\n{body}\n</tbody></table></div>'


def _th(text: str) -> str:
    return f'<th scope="row">{escape(text)}</th>'


def _number(text: str) -> str:
    return f'<td data-value="{text}">{text}</td>' if text else "<td></td>"
