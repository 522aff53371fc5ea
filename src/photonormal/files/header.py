"""What a picture file claims to hold, read before anything is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from photonormal.types import InputError


@dataclass(frozen=True)
class Header:
    """Size of a picture in pixels, and the bytes that decoding it takes."""

    height: int
    width: int
    nbytes: int


def damaged(path: Path, what: str) -> InputError:
    """The error that says what is wrong with a picture file."""
    return InputError(f"picture {path} {what}, but a whole picture is needed; copy or export it again.")
