"""What a summary says of one capture."""

from __future__ import annotations

from dataclasses import dataclass

PAGE = "view.html"  # in the folder of a result


@dataclass(frozen=True)
class CaptureRow:
    """One capture."""

    capture: str  # its name, and the folder of its result
    state: str  # "done", "failed" or "not begun"
    failure: str = ""
    pixels: int | None = None  # with a normal
    lights: int | None = None
    expected_error_deg: float | None = None
    error_deg: float | None = None  # against the truth, where it is known
    grave: int | None = None  # findings that spoil normals
    findings: int | None = None
    warnings: str = ""
    seconds: float | None = None
    memory_mb: float | None = None
    method: str = ""
    version: str = ""
    source: str = ""
    page: str = ""  # that shows the result, below the folder of the batch
