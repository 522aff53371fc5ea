"""A row for each capture of a batch, read from the reports of the results, as a table that other programs read."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from photonormal.batch.page import page
from photonormal.batch.row import PAGE, CaptureRow
from photonormal.batch.state import Failure
from photonormal.capture.pictures import natural
from photonormal.export.folder import MARKER, REPORT, report, reported_below, whole_folder
from photonormal.stored import read_json
from photonormal.types import InputError

PATIENCE_S = 60.0  # for another batch that is just writing its summary


class PixelCounts(TypedDict):
    """How many there are."""

    mask: int
    measured: int


class StoredScore(TypedDict):
    """How far the normals are off where the truth is known."""

    mean_deg: float


class StoredFinding(TypedDict):
    """What the doctor says."""

    kind: str
    grave: bool
    message: str


class Reported(TypedDict):
    """What a summary says of a report."""

    written_by: str
    failed: NotRequired[Failure]
    source: NotRequired[str]
    files: NotRequired[dict[str, int]]
    method: NotRequired[str]
    photonormal: NotRequired[str]
    pixels: NotRequired[PixelCounts]
    lights: NotRequired[int]
    expected_error_deg: NotRequired[float]
    score: NotRequired[StoredScore]
    findings: NotRequired[list[StoredFinding]]
    warnings: NotRequired[list[str]]
    seconds: NotRequired[dict[str, float]]
    peak_memory_mb: NotRequired[float | None]


class Summary:
    """The rows of a batch, and its files: a row for each capture, and for each other result below `out`."""

    def __init__(self, out: Path, names: Iterable[str], overwrite: bool) -> None:
        self.out, self.overwrite = out, overwrite
        self._rows = {name: row(name, out / name) for name in names}
        self._names = set(self._rows)
        self.read_others()

    def read_others(self) -> None:
        """Look again at what is known of captures that are not this batch's: another may be at work below `out`."""
        for name in [folder.relative_to(self.out).as_posix() for folder in reported_below(self.out)]:
            if name not in self._names:
                self.read(name)
                if (seen := self._rows[name]).failure:
                    which = f"{seen.failure} It was named in another run: remove {self.out / name} if it is no capture."
                    self._rows[name] = replace(seen, failure=which)

    def read(self, name: str) -> None:
        """Look again at what is known of a capture."""
        self._rows[name] = row(name, self.out / name)

    def rows(self) -> list[CaptureRow]:
        """What failed comes first, then in the order of names."""
        return sorted(self._rows.values(), key=lambda row: (row.state != "failed", natural(row.capture)))

    def write(self) -> None:
        """Put the summary into the folder of the batch, at once, in place of the one before."""
        table = self.rows()
        with whole_folder(self.out, self.overwrite, wait_seconds=PATIENCE_S) as batch:
            batch.write("summary.csv", as_csv(table))
            if (data := as_parquet(table)) is not None:
                batch.write("summary.parquet", data)
            batch.write("index.html", page(table, self.out.resolve().name))
            states = [row.state for row in table]
            report(batch, {"captures": {state: states.count(state) for state in dict.fromkeys(states)}})


def row(name: str, folder: Path) -> CaptureRow:
    """What the folder of its result says of a capture."""
    try:
        record = read_json(folder / REPORT, Reported, "measure again")
    except InputError:
        return CaptureRow(name, "not begun")
    if record["written_by"] != MARKER["written_by"]:
        return CaptureRow(name, "not begun")
    failed = record.get("failed")
    made = "pixels" in record
    found = record.get("findings", [])
    return CaptureRow(
        name,
        "failed" if failed else "done" if made else "not begun",
        failed["message"] if failed else "",
        record["pixels"]["measured"] if "pixels" in record else None,
        record.get("lights"),
        record.get("expected_error_deg"),
        record["score"]["mean_deg"] if "score" in record else None,
        sum(f["grave"] for f in found) if made else None,
        len(found) if made else None,
        " ".join(record.get("warnings", [])),
        round(sum(record["seconds"].values()), 3) if "seconds" in record else None,
        record.get("peak_memory_mb"),
        record.get("method", ""),
        record.get("photonormal", ""),
        record.get("source", ""),
        f"{name}/{PAGE}" if PAGE in record.get("files", {}) else "",
    )


def as_parquet(table: Sequence[CaptureRow]) -> bytes | None:
    """The same, each column with its kind; None where pyarrow is not installed."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return None
    kinds = {"str": pyarrow.string(), "int | None": pyarrow.int64(), "float | None": pyarrow.float64()}
    schema = pyarrow.schema([(f.name, kinds[str(f.type)]) for f in fields(CaptureRow)])
    to = pyarrow.BufferOutputStream()
    rows = [{k: _text(v) for k, v in asdict(row).items()} for row in table]
    parquet.write_table(pyarrow.Table.from_pylist(rows, schema), to)
    return to.getvalue().to_pybytes()


def _text(value: Any) -> Any:
    """Names that are no UTF-8, escaped."""
    return value.encode("utf-8", "backslashreplace").decode() if isinstance(value, str) else value


def as_csv(table: Sequence[CaptureRow]) -> bytes:
    """UTF-8 with a header, as spreadsheets read it."""
    text = io.StringIO()
    to = csv.DictWriter(text, [f.name for f in fields(CaptureRow)], lineterminator="\r\n")
    to.writeheader()
    to.writerows(_safe(asdict(row)) for row in table)
    return b"\xef\xbb\xbf" + text.getvalue().encode("utf-8", "backslashreplace")


def _safe(row: dict[str, Any]) -> dict[str, Any]:
    """Names that a spreadsheet would take for formulas are quoted."""
    return {k: f"'{v}" if isinstance(v, str) and v.startswith(("=", "+", "-", "@")) else v for k, v in row.items()}
