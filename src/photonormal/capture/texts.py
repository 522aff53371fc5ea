"""Tables of numbers in text files as people really write them: BOM, CRLF, tabs, commas, decimal commas, blank lines."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from photonormal.types import InputError

_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")


def read_lines(path: Path) -> list[str]:
    """Stripped lines that are not empty."""
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} is missing; restore it or name another format with --format.") from None
    except OSError as error:
        raise InputError(f"{path} can't be read ({error.strerror}); check its permissions.") from None
    try:
        lines = text.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        lines = text.decode("latin-1").splitlines()
    return [line.strip() for line in lines if line.strip()]


def number(token: str) -> float:
    """A number with a decimal point or a decimal comma; ValueError otherwise."""
    return float(token.replace(",", ".") if _DECIMAL_COMMA.fullmatch(token) else token)


def read_table(path: Path) -> np.ndarray:
    """Rows of numbers, separated by white space, semicolons or commas; lines that start with # are remarks."""
    rows = []
    for k, line in enumerate(read_lines(path)):
        if line.startswith("#"):
            continue
        tokens = [t for t in re.split(r"[\s;]+", line) if t]
        try:
            if len(tokens) == 1 or any(t.endswith(",") for t in tokens):
                tokens = [t for t in re.split(r"[\s;,]+", line) if t]
            rows.append([number(t) for t in tokens])
        except ValueError:
            raise InputError(f"line {k + 1} of {path} is {line[:60]!r} but numbers are needed; correct it.") from None
    if not rows or len({len(r) for r in rows}) != 1:
        raise InputError(
            f"{path} has rows of {sorted({len(r) for r in rows})} numbers; one table with equal rows is needed."
        )
    return np.array(rows)


def read_directions(path: Path) -> np.ndarray:
    """Light directions (n, 3) from a table of n rows, or of 3 rows and n columns."""
    table = read_table(path)
    if table.shape[1] == 3:
        return table
    if table.shape[0] == 3:
        return table.T
    raise InputError(f"{path} is a table of {table.shape} but (n, 3) or (3, n) directions are needed; correct it.")


def read_intensities(path: Path, n: int) -> np.ndarray:
    """Light intensities (n, 1) or (n, 3), positive."""
    table = read_table(path)
    if table.shape[0] != n and table.shape[1] == n:
        table = table.T
    if table.shape not in ((n, 1), (n, 3)):
        raise InputError(f"{path} is a table of {table.shape} but ({n}, 1) or ({n}, 3) intensities are needed.")
    bad = np.flatnonzero(~(np.isfinite(table) & (table > 0)).all(1))
    if bad.size:
        raise InputError(
            f"row {bad[0] + 1} of {path} is {table[bad[0]].tolist()} but light intensities above 0 are needed."
        )
    return table
