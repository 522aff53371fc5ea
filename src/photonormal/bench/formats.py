"""Tables as Markdown, LaTeX and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from photonormal.bench.published import Published
from photonormal.bench.tables import AVERAGE, MEAN, Cell, Column, ErrorTable, MethodRow

NAMES = {"mean_deg": "mean, deg", "below_15": "< 15 deg, %", "below_30": "< 30 deg, %"}


@dataclass(frozen=True)
class Markup:
    """How a language writes what a table needs."""

    bold: Callable[[str], str]
    underlined: Callable[[str], str]
    small: Callable[[str], str]
    text: Callable[[str], str]
    pm: str
    table: Callable[[list[str], list[list[str]]], str]
    title: Callable[[str], str]
    paragraph: Callable[[str], str]


def markdown(tables: Sequence[ErrorTable]) -> str:
    """For documents: best in bold, second underlined, published figures small."""
    return "\n".join(_written(t, MARKDOWN) for t in tables)


def latex(tables: Sequence[ErrorTable]) -> str:
    """The same as tabulars, which need no package."""
    return "\n".join(_written(t, LATEX) for t in tables)


def as_json(tables: Sequence[ErrorTable]) -> str:
    """All figures unrounded enough to compute with; measured and published apart."""
    return json.dumps([_plain(t) for t in tables], indent=1, ensure_ascii=False) + "\n"


def _written(table: ErrorTable, m: Markup) -> str:
    parts = [m.title(table.title)]
    if table.columns:
        spread = " ± standard deviation over the draws" if table.protocol == "draws" else ""
        small = "Small: as published, and ours less theirs. " if any(r.sources for r in table.rows) else ""
        parts += [
            m.paragraph(
                f"Mean angular error in degrees{spread}. {small}Best in bold, second underlined. Blank: not there."
            ),
            m.table(["method", *(heading(table, c) for c in table.columns)], [_cells(r, table, m) for r in table.rows]),
        ]
    else:
        parts.append(m.paragraph("There are no true normals: nothing to score."))
    parts += [
        m.paragraph("Seconds for one object (median) and largest memory, measured in the same run:"),
        m.table(
            ["method", "read, s", "solve, s", "peak memory, MB", "GPU memory, MB", "on"],
            [[m.text(r.label), *(m.text(t) for t in costs(r))] for r in table.rows],
        ),
    ]
    if table.only_published:
        head, rows = published_rows(table)
        parts.append(m.paragraph("Published by others, not measured here:"))
        parts.append(m.table(head, [[m.text(name), *values] for name, *values in rows]))
    parts += [m.paragraph(m.text(note)) for note in notes(table)]
    return "\n".join(parts)


def heading(table: ErrorTable, column: Column) -> str:
    """What stands above a column; an average says over how many objects."""
    counts = {AVERAGE: f"average of {table.over}", MEAN: f"mean of {table.over}, deg"}
    return counts.get(column) or NAMES.get(column.name, column.name)


def published_rows(table: ErrorTable) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of methods that are only published: their average over our objects, and over all as printed."""
    columns = [c for c in table.columns if c.kind != "sound average"]
    head = ["method", *(NAMES.get(c.name) or heading(table, c) for c in columns)]
    rows = []
    for p in table.only_published:
        values = [p.value(c.name, table.measured) for c in columns]
        if AVERAGE in columns:
            values.append(p.values.get(AVERAGE.name))
        rows.append([p.name, *("" if v is None else f"{v:.2f}" for v in values)])
    return [*head, *(["average as printed"] if AVERAGE in columns else [])], rows


def shortfall(row: MethodRow, table: ErrorTable, column: Column) -> str:
    """What stands behind a row's average that is over fewer objects or draws than others: " (of 3, 20 draws)"."""
    if column not in (AVERAGE, MEAN):
        return ""
    parts = [f"of {row.over}"] * (row.over != table.over) + [f"{row.draws} draws"] * (row.draws != table.draws)
    return f" ({', '.join(parts)})" if parts else ""


def costs(row: MethodRow) -> list[str]:
    """Seconds, memory and machine of a row, as text."""
    c = row.cost
    numbers = [c.read_s, c.solve_s, c.peak_memory_mb, c.gpu_memory_mb]
    places = [2, 2, 0, 0]
    return ["" if v is None else f"{v:.{p}f}" for v, p in zip(numbers, places, strict=True)] + [c.machine]


def notes(table: ErrorTable) -> list[str]:
    """Where the published figures come from, what is known about them, and which version measured ours."""
    used = [(r.label, p) for r in table.rows for p in r.sources]
    places: dict[str, list[str]] = {}
    for label, p in used:
        places.setdefault(f"{p.cite}, {p.where}", []).append(label)
    found = [f"Published: {place} ({', '.join(labels)})." for place, labels in places.items()]
    found += [f"{p.name}: {p.remark}." for p in [p for _, p in used] + list(table.only_published) if p.remark]
    other = [label for label, p in used if p.protocol != table.protocol]
    if other:
        found.append(f"Published figures of another choice of images: {', '.join(dict.fromkeys(other))}.")
    if table.only_published:
        found.append(f"Sources: {'; '.join(dict.fromkeys(f'{p.cite}, {p.where}' for p in table.only_published))}.")
    return [*dict.fromkeys(found), f"Measured with photonormal {', '.join(table.versions)}."]


def _cells(row: MethodRow, table: ErrorTable, m: Markup) -> list[str]:
    found = [m.text(row.label)]
    for column in table.columns:
        cell = row.cells.get(column.name)
        if cell is None:
            found.append("")
            continue
        text = f"{cell.value:.2f}" + ("" if cell.spread is None else f" {m.pm} {cell.spread:.2f}")
        text = {1: m.bold, 2: m.underlined}.get(table.rank(column).get(row.label, 0), str)(text)
        text += shortfall(row, table, column)
        found.append(text + (f" {m.small(set_against(cell))}" if cell.published is not None else ""))
    return found


def set_against(cell: Cell) -> str:
    """The published figure and the difference."""
    return f"{cell.published:.2f}, {round(cell.difference or 0, 2) + 0.0:+.2f}"  # never -0.00


def _plain(table: ErrorTable) -> dict:
    def published(p: Published) -> dict:
        return {"name": p.name, "values": p.values, "source": f"{p.cite}, {p.where}", "remark": p.remark}

    return {
        "dataset": table.dataset,
        "protocol": table.protocol,
        "images": table.images or None,
        "draws": table.draws,
        "photonormal": list(table.versions),
        "columns": [c.name for c in table.columns],
        "higher_is_better": [c.name for c in table.columns if c.higher],
        "rows": [
            {
                "method": r.label,
                "measured": {c: round(v.value, 4) for c, v in r.cells.items()},
                "spread": {c: round(v.spread, 4) for c, v in r.cells.items() if v.spread is not None},
                "average_over": r.over,
                "draws": r.draws,
                "seconds": {"read": r.cost.read_s, "solve": r.cost.solve_s},
                "peak_memory_mb": r.cost.peak_memory_mb,
                "gpu_memory_mb": r.cost.gpu_memory_mb,
                "machine": r.cost.machine,
                "published": [published(p) for p in r.sources],
                "difference": {c: round(v.difference, 4) for c, v in r.cells.items() if v.difference is not None},
            }
            for r in table.rows
        ],
        "published_only": [published(p) for p in table.only_published],
    }


def _markdown_table(head: list[str], rows: list[list[str]]) -> str:
    lines = [[_markdown_text(h) for h in head], ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _markdown_text(text: str) -> str:
    return text.replace("|", "\\|")


def _latex_table(head: list[str], rows: list[list[str]]) -> str:
    body = [" & ".join(line) + r" \\" for line in rows]
    lines = [" & ".join(_latex_text(h) for h in head) + r" \\", r"\hline", *body]
    return "\n".join(
        [f"\\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}", r"\hline", *lines, r"\hline", r"\end{tabular}", ""]
    )


def _latex_text(text: str) -> str:
    return text.translate(LATEX_TEXT)


LATEX_TEXT = str.maketrans(
    {c: f"\\{c}" for c in "&%_#${}"}
    | {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
    | {"<": "$<$", ">": "$>$", "|": "$|$", "±": r"$\pm$", "†": r"$\dagger$"}
)
MARKDOWN = Markup(
    bold="**{}**".format,
    underlined="<u>{}</u>".format,
    small="<sub>{}</sub>".format,
    text=_markdown_text,
    pm="±",
    table=_markdown_table,
    title="## {}\n".format,
    paragraph="{}\n".format,
)
LATEX = Markup(
    bold=r"\textbf{{{}}}".format,
    underlined=r"\underline{{{}}}".format,
    small=r"{{\scriptsize {}}}".format,
    text=_latex_text,
    pm=r"$\pm$",
    table=_latex_table,
    title=lambda t: f"\\subsection*{{{_latex_text(t)}}}\n",
    paragraph=lambda t: f"\n{t.replace('±', '$' + chr(92) + 'pm$')}\n\n",
)
FORMATS = {"markdown": markdown, "latex": latex, "json": as_json}
