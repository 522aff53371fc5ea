"""Files that photonormal wrote and reads again: JSON of one schema each, of bounded size and depth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta

from photonormal.files.opening import open_file, size_of
from photonormal.types import InputError

T = TypeVar("T")

LONGEST = 2**26  # bytes of a JSON file

Word = Annotated[str, Meta(max_length=4096, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]  # no line ends, no terminal escapes
Name = Annotated[  # of a file below a folder, too
    str, Meta(min_length=1, max_length=1024, pattern=r"^(?!/)(?!.*\.\.)[^\\\x00-\x1f\x7f-\x9f]+$")
]
Size = Annotated[int, Meta(ge=0, le=4096)]
Vectors = Annotated[list[tuple[float, float, float]], Meta(max_length=4096)]


def decoded(text: str | bytes, kind: type[T], what: object, advice: str) -> T:
    """A JSON text of a kind; `what` names it and `advice` says what to do where it is anything else."""
    try:
        return msgspec.json.decode(text, type=kind)
    except (ValueError, RecursionError) as error:  # msgspec's own errors are ValueErrors
        reason = "it is nested too deep" if isinstance(error, RecursionError) else _line(error)
        raise InputError(f"{what} can't be read ({reason}); {advice}.") from None


def converted(value: Any, kind: type[T], what: object, advice: str) -> T:
    """As `decoded`, from values already in memory."""
    try:
        return msgspec.convert(value, kind)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{what} can't be read ({_line(error)}); {advice}.") from None


def read_json(path: Path, kind: type[T], advice: str) -> T:
    """A JSON file of a kind; InputError where it is anything else."""
    return decoded(stored_bytes(path, advice, LONGEST), kind, path, advice)


def stored_bytes(path: Path, advice: str, longest: int) -> bytes:
    """A regular file of at most `longest` bytes."""
    try:
        with open_file(path) as file:
            if (size := size_of(file)) > longest:
                raise InputError(f"{path} has {size} bytes but at most {longest} are read; {advice}.")
            return file.read(size)
    except OSError as error:
        raise InputError(f"{path} can't be read ({_line(error)}); {advice}.") from None


def _line(error: Exception) -> str:
    """The first line of what an error says, cut to a readable length."""
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return (said.strip() or type(error).__name__).splitlines()[0][:200]
