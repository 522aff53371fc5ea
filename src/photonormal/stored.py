"""Files that photonormal wrote and reads again: JSON of one schema each, arrays; both of bounded size and depth."""

from __future__ import annotations

import stat
import zipfile
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from photonormal.types import InputError

T = TypeVar("T")

LONGEST = 2**26  # bytes of a JSON file
LARGEST = 2**30  # bytes of the arrays in a file

Word = Annotated[str, Meta(max_length=4096, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]  # no line ends, no terminal escapes
Name = Annotated[  # of a file below a folder, too
    str, Meta(min_length=1, max_length=1024, pattern=r"^(?!/)(?!.*\.\.)[^\\\x00-\x1f\x7f-\x9f]+$")
]
Size = Annotated[int, Meta(ge=0, le=4096)]


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
    return decoded(read_bytes(path, advice, LONGEST), kind, path, advice)


def read_bytes(path: Path, advice: str, longest: int) -> bytes:
    """A regular file of at most `longest` bytes."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path} is no file; {advice}.")
        if status.st_size > longest:
            raise InputError(f"{path} has {status.st_size} bytes but at most {longest} are read; {advice}.")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # a null byte in a name is a ValueError
        raise InputError(f"{path} can't be read ({_line(error)}); {advice}.") from None


def read_arrays(path: Path, advice: str) -> dict[str, np.ndarray]:
    """The arrays of an .npz file, of numbers only and LARGEST bytes in all, by name."""
    try:
        if not path.is_file():
            raise ValueError("it is no file")
        with zipfile.ZipFile(path) as archive:
            total = 0
            for member in archive.infolist():
                with archive.open(member) as file:
                    version = np.lib.format.read_magic(file)
                    header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
                    shape, _, dtype = header[version](file)
                size = dtype.itemsize * int(np.prod([float(n) for n in shape]))
                total += size
                if dtype.kind not in "biuf" or min(shape, default=0) < 0 or size > member.file_size:
                    raise ValueError(f"{member.filename!r} is no array of numbers")
            if total > LARGEST:
                raise ValueError(f"its arrays have {total} bytes, more than {LARGEST}")
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    except MemoryError:
        raise InputError(f"{path} can't be read (memory does not suffice); {advice}.") from None
    except Exception as error:  # a damaged file fails in many ways
        raise InputError(f"{path} can't be read ({_line(error)}); {advice}.") from None


def _line(error: Exception) -> str:
    """The first line of what an error says, cut to a readable length."""
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return (said.strip() or type(error).__name__).splitlines()[0][:200]
