"""Tables of numbers in text files as people really write them: BOM, CRLF, tabs, commas, decimal commas, blank lines."""

from __future__ import annotations

import codecs
import os
import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from photonormal.files.opening import TEXT, read_bytes
from photonormal.types import InputError

_MINUS = str.maketrans("\u2212\u2013\uff0d", "---")  # what word processors make of a hyphen
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")


def read_lines(path: Path) -> list[str]:
    """Stripped lines that are not empty."""
    data = read_bytes(path, "a text file", TEXT)
    # names in it that aren't UTF-8 stay the bytes that they are on disk
    wide = _utf_16(data)
    text = data.decode(wide, "replace") if wide else data.decode("utf-8-sig", "surrogateescape")
    text = text.rstrip("\x1a\0 \r\n")  # DOS ended files by control-Z
    if "\0" in text:
        raise InputError(f"{path} is no text but a text file is needed; save it as text, or name another.")
    return [line.strip() for line in re.split(r"[\r\n]+", text) if line.strip()]


def _utf_16(data: bytes) -> str:
    """The UTF-16 that a text is in, by its mark or by zeros in every other byte; empty where it isn't."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    even, odd = (data[k::2].count(0) / max(len(data) // 2, 1) for k in (0, 1))
    return "" if abs(even - odd) < 0.5 else "utf-16-le" if odd > even else "utf-16-be"


def spellings(name: str) -> list[str]:
    """A name from a list by the bytes that it has there, and as text, which is Latin-1 where it isn't UTF-8.

    An accent may be part of its letter, or follow it, as in files that come from a Mac.
    """
    if name.isascii():
        return [name]
    text = os.fsencode(name).decode("latin-1") if re.search("[\udc80-\udcff]", name) else name
    return [name, *(unicodedata.normalize(form, text) for form in ("NFC", "NFD")), text]


def beside(folder: Path, name: str) -> Path:
    """The file that a list in `folder` names, whichever of the name's spellings it has."""
    found = [folder / n for n in spellings(name)]
    return next((p for p in found if os.path.lexists(p)), found[-1])


def number(token: str) -> float:
    """A number with a decimal point or a decimal comma; ValueError otherwise."""
    token = token.translate(_MINUS)
    return float(token.replace(",", ".") if _DECIMAL_COMMA.fullmatch(token) else token)


def read_table(path: Path) -> np.ndarray:
    """Rows of numbers, separated by white space, semicolons or commas; lines that start with # are remarks."""
    rows = []
    for line in read_lines(path):
        if line.startswith("#"):
            continue
        tokens = [t for t in re.split(r"[\s;]+", line) if t]
        try:
            # commas separate unless each number holds one at most: 0,5 0,1 0,8
            if any(t.endswith(",") or t.count(",") > 1 for t in tokens):
                tokens = [t for t in re.split(r"[\s;,]+", line) if t]
            rows.append([number(t) for t in tokens])
        except ValueError:
            raise InputError(f"{path} has the line {line[:60]!r} but numbers are needed; correct it.") from None
    widths = sorted({len(r) for r in rows})
    if len(widths) != 1 or widths == [0]:
        came = f"rows of {', '.join(map(str, widths))} numbers" if any(widths) else "no numbers"
        raise InputError(f"{path} has {came} but one table with equal rows is needed; correct it.")
    return np.array(rows)


def read_named(lines: Sequence[str], path: Path) -> tuple[list[str], np.ndarray]:
    """Names, which may hold spaces, and directions (n, 3) of lines `name x y z`."""
    names, directions = [], []
    for k, line in enumerate(lines, 1):
        name, *numbers = line.rsplit(maxsplit=3)
        try:
            x, y, z = map(number, numbers)
        except ValueError:
            raise InputError(f"line {k} of {path} is {line[:60]!r} but `name x y z` is needed; correct it.") from None
        names.append(name.strip('"'))
        directions.append([x, y, z])
    return names, np.array(directions).reshape(-1, 3)


def read_intensities(path: Path, *counts: int) -> np.ndarray:
    """Light intensities (n, 1) or (n, 3), positive; n is the first of the `counts` that the table can have."""
    table = read_table(path)
    for n in counts:
        for rows in (table, table.T):
            if rows.shape in ((n, 1), (n, 3)):
                return positive(rows, path)
    raise InputError(
        f"{path} is a table of {table.shape} but ({counts[0]}, 1) or ({counts[0]}, 3) intensities are needed, one row "
        "for each picture; correct it."
    )


def positive(table: np.ndarray, path: Path) -> np.ndarray:
    """The intensities in `table`, or an error that names the row that holds none."""
    bad = np.flatnonzero(~(np.isfinite(table) & (table > 0)).all(1))
    if bad.size:
        raise InputError(
            f"row {bad[0] + 1} of {path} is {table[bad[0]].tolist()} but light intensities above 0 are needed; "
            "correct it."
        )
    return table
