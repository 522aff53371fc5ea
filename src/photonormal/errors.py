"""What is said to a user whose input can't be used."""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar

KNOWN = (  # where our code and that of libraries lies
    Path(__file__).resolve().parents[1],
    *(Path(sysconfig.get_path(kind)).resolve() for kind in ("stdlib", "platstdlib", "purelib", "platlib", "scripts")),
)
LONGEST = 2000  # characters of a message
LONGEST_NAME = 300  # of what the user called something

T = TypeVar("T")


class InputError(ValueError):
    """What the user gave can't be used. One line: what came, what was needed, what to do."""

    def __init__(self, message: str):
        super().__init__(printable(" ".join(message.splitlines())))


class MachineLimit(InputError):
    """What came can be used, but not by this machine as it is now: its memory or its disks are at their end."""


def printable(text: str) -> str:
    """The text without what a terminal would obey, since names of files may hold anything; cut where it is very long.

    >>> printable("red \\x1b[31m.png")
    'red \\\\x1b[31m.png'
    """
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 2]} [...] {text[-LONGEST // 2 :]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def no_such(what: str, name: str, known: Iterable[str]) -> InputError:
    """That there is nothing of that name, which one may be meant, and which there are.

    >>> str(no_such("frame", "opngl", ["opengl", "blender"]))
    "no frame 'opngl'; perhaps opengl is meant; choose from opengl, blender."
    """
    known = list(known)
    close = "".join(f"; perhaps {other} is meant" for other in get_close_matches(name, known, 1))
    return InputError(f"no {what} {name[:LONGEST_NAME]!r}{close}; choose from {', '.join(known)}.")


def by_name(what: str, name: str, table: Mapping[str, T]) -> T:
    """What a table has of that name; `no_such` where it has nothing."""
    if name not in table:
        raise no_such(what, name, table)
    return table[name]


def a_few(names: Sequence[str], most: int = 3) -> str:
    """Some of the names, and how many there are besides.

    >>> a_few(["a.png", "b.png", "c.png"], 2)
    'a.png, b.png and 1 more'
    """
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def in_pixels(shape: tuple[int, ...]) -> str:
    """Width and height, as people name them, of an array (h, w, ...).

    >>> in_pixels((90, 96, 3))
    '96 x 90 pixels'
    """
    return f"{shape[1]} x {shape[0]} pixels"


def code_of_others(error: BaseException) -> str | None:
    """Where in a user's own code, such as a method of one file, an error was raised; None where it is all ours.

    A script's own lines, which only call us, are no cause.
    """
    found = None
    for frame in traceback.extract_tb(error.__traceback__):
        path = Path(frame.filename).resolve()
        known = frame.filename.startswith("<") or any(path.is_relative_to(place) for place in KNOWN)
        if not known and frame.name != "<module>":
            found = f"{path.name}, line {frame.lineno}"
    return found
