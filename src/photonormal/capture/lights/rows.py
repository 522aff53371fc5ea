"""Lights in text: `.lp`, CSV and tables, as RTIBuilder, RelightLab, ImageJ, Excel and people write them.

    3                                     a count, or none
    DSC 0001.jpg 0.34 -0.20 0.92          a picture's name, or none, and its light
    ...

Cells are separated by semicolons or tabs, commas, or white space (numbers may have decimal commas then). The first
line may say what the columns are; further columns and remarks after # are left out. Names may stand in another column.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from photonormal.capture.lights.table import LightTable
from photonormal.capture.texts import number, read_lines
from photonormal.files.decode import SUFFIXES
from photonormal.types import InputError

COUNT = re.compile(r'"?([0-9]{1,9})"?[\s,;]*')
REMARK = re.compile(r"(^|\s)(#|//|%)|^\W?(?i:sep)=\W{0,2}$")  # or sep=; which is written for spreadsheets
NAMED = re.compile(rf'"?(.*(?:{"|".join(map(re.escape, sorted(SUFFIXES)))}))"?(?=[\s,;]|$)(.*)', re.IGNORECASE)
NAME = re.compile(rf'[^;,\t]*(?:{"|".join(map(re.escape, sorted(SUFFIXES)))})"?', re.IGNORECASE)
NUMBER_OF_ROW = re.compile(
    r"|#|no\.?|nr\.?|num(ber)?|id|idx|index|(image|picture|photo|light|file)( ?(name|number|no\.?))?"
)
SEPARATORS = (r"[;\t]", ",", r"[\s;]+")


def read(path: Path) -> LightTable:
    """Names and numbers of the rows, and what the header calls the columns."""
    lines = list(enumerate(read_lines(path), 1))
    remarks = [line.lstrip("#/% ") for _, line in lines if REMARK.match(line)]
    lines = [(k, line) for k, line in lines if not REMARK.match(line)]
    count = COUNT.fullmatch(lines[0][1]) if lines else None
    lines = lines[1:] if count else lines
    header = _header(lines[0][1]) if lines else None
    header, rows = _names_in_front(header, lines[1:] if header else lines)
    names, numbers = _rows(rows, path)
    notes = ()
    if count and int(count[1]) != len(numbers):
        said = f"says {int(count[1])} pictures but lists {len(numbers)}"
        if not names:
            raise InputError(f"{path} {said}; correct its first line or the list.")
        notes = (f"{path.name} {said}, which were used.",)
    width, before = numbers.shape[1], 1 if names else 0
    if header is None and remarks:  # `# x y z`, as NumPy writes it
        header = _header(remarks[-1])
        header = header if header and len(header) in (width, before + width) else None
    columns = header or []
    if len(columns) >= before + width:  # there may be more, of words
        columns = columns[before : before + width]
    elif columns:  # the first has no word
        columns = [""] * (width - len(columns)) + columns[-width:]
    return _with_row_numbers(LightTable(names, numbers, tuple(columns), notes=notes))


def _names_in_front(
    header: list[str] | None, lines: list[tuple[int, str]]
) -> tuple[list[str] | None, list[tuple[int, str]]]:
    """The same with the column of pictures' names as the first, where only numbers stand before it.

    Fewer than three of them without a header are no light, but numbers of rows, and are left out.
    """
    for separator in SEPARATORS:
        rows = [[cell.strip() for cell in re.split(separator, line)] for _, line in lines]
        first = 3 if separator == SEPARATORS[-1] else 1  # white space may be a name's own
        for j in range(first, min(map(len, rows), default=0)):
            named = all(NAME.fullmatch(row[j]) and all(map(_is_number, row[:j])) for row in rows)
            if named and (header is None or len(header) > j):
                kept = 0 if header or j >= 3 else j
                moved = [";".join([row[j], *row[kept:j], *row[j + 1 :]]) for row in rows]
                header = header and [header[j], *header[:j], *header[j + 1 :]]
                return header, [(k, row) for (k, _), row in zip(lines, moved, strict=True)]
    return header, lines


def _rows(lines: list[tuple[int, str]], path: Path) -> tuple[list[str], np.ndarray]:
    """Names, none where there are none, and numbers (n, k) of numbered lines, which have to be alike."""
    rows = [_row(line, k, path) for k, line in lines]
    if not rows:
        raise InputError(
            f"{path} holds no lights but one for each picture is needed, `name x y z` or `x y z`; add them."
        )
    named, width = bool(rows[0][0]), len(rows[0][1])
    for (k, line), (name, numbers) in zip(lines, rows, strict=True):
        further = named and min(width, len(numbers)) >= 3
        if bool(name) != named or (len(numbers) != width and not further):
            raise _unlike(line, k, path)
        width = min(width, len(numbers))
    return [name for name, _ in rows if name], np.array([numbers[:width] for _, numbers in rows])


def _with_row_numbers(table: LightTable) -> LightTable:
    """Names in the first column where they are numbers: a header has no word for that column, or one for names."""
    if table.names or not table.columns or not NUMBER_OF_ROW.fullmatch(table.columns[0]):
        return table
    names = [f"{v:g}" for v in table.numbers[:, 0]]
    return LightTable(names, table.numbers[:, 1:], table.columns[1:], notes=table.notes)


def _header(line: str) -> list[str] | None:
    """Names of the columns, in small letters, where a line holds words alone; None: it holds none, or one."""
    if NAMED.match(line):
        return None
    separator = next((s for s in SEPARATORS[:2] if re.search(s, line)), r"\s+")
    cells = [c.strip().strip('"').lower() for c in re.split(separator, line)]
    words = [c for c in cells if re.search(r"[^\W\d_]", c)]
    return cells if len(words) > 1 and not any(map(_is_number, cells)) else None


def _row(line: str, k: int, path: Path) -> tuple[str, list[float]]:
    """A picture's name, or none, and the numbers after it."""
    named = NAMED.match(line)
    name, rest = (named[1], named[2]) if named else ("", line)
    remark = REMARK.search(rest)
    rest = (rest[: remark.start()] if remark else rest).strip(" ,;\t")
    for separator in SEPARATORS:
        cells = [c.strip().strip('"') for c in re.split(separator, rest)]
        first = 0 if named else _first_number(cells, separator == SEPARATORS[-1])
        numbers = _numbers(cells[first:])
        if len(numbers) < 2:
            continue
        if separator == "," and len(numbers) == 6 and not re.search(r"[.eE]", "".join(cells[first:])):
            break  # 0,5,0,2,0,8: decimal commas between commas
        if not named and first:
            name = cells[0] if separator != SEPARATORS[-1] else rest.rsplit(maxsplit=len(cells) - first)[0]
        return name.strip().strip('"'), numbers
    raise _unlike(line, k, path)


def _unlike(line: str, k: int, path: Path) -> InputError:
    return InputError(
        f"line {k} of {path} is {line[:60]!r} but `name x y z` or `x y z` is needed, the same in every line; "
        "correct it."
    )


def _first_number(cells: list[str], spaces: bool) -> int:
    """Where the numbers begin in cells without a picture's name: at once, or after a name, which may hold spaces."""
    if all(map(_is_number, cells)):
        return 0
    if not spaces:
        return 1
    words = max(j for j, cell in enumerate(cells) if not _is_number(cell))
    return max(words + 1, len(cells) - 3)


def _numbers(cells: list[str]) -> list[float]:
    """The numbers that the cells begin with."""
    found: list[float] = []
    for cell in cells:
        if not _is_number(cell):
            break
        found.append(number(cell))
    return found


def _is_number(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True
