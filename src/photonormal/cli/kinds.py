"""How options are shown in the help, what to give and no default where there is none; and what commands print."""

from __future__ import annotations

import dataclasses
import os
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import tyro

from photonormal.options import Count, Device, Positive
from photonormal.types import printable


def shown(metavar: str) -> Any:
    """An option without a default to speak of, and what to give for it."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


File = Annotated[Path | None, shown("FILE")]
Folder = Annotated[Path | None, shown("FOLDER")]
FileOrFolder = Annotated[Path | None, shown("FILE|FOLDER")]
Millimetres = Annotated[Positive | None, shown("MM")]
Pixels = Annotated[Positive | None, shown("PX")]
Degrees = Annotated[float | None, shown("DEGREES")]
Number = Annotated[Count | None, shown("N")]
Numbers = Annotated[str, shown("NUMBERS")]
Name = Annotated[str, shown("NAME")]
Names = Annotated[str, shown("NAMES")]
Box = Annotated[str, shown("X0,Y0,X1,Y1")]
Size = Annotated[str, shown("SIZE")]
Where = Annotated[Device, tyro.conf.arg(metavar="{auto,cpu,cuda}")]


def tell(line: str) -> None:
    """Print what was found out beside the results."""
    print(f"photonormal: {printable(line)}", file=sys.stderr)


def say_no_more() -> None:
    """What comes on standard output goes nowhere: its reader has gone, of which Python would complain at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def warn(warnings: list[str]) -> None:
    """Print the warnings of a report."""
    for warning in warnings:
        tell(f"warning: {warning}")


def next_step(*words: object) -> None:
    """Print the command that usually comes next."""
    print(printable("next: photonormal " + " ".join(shlex.quote(str(word)) for word in words)))


def words_of(options: Any) -> Iterator[str]:
    """The words of the command line for the options, of a dataclass or of those in it, that are not as by default."""
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            yield from words_of(value)
        elif value != field.default:
            name = field.name.replace("_", "-")
            if isinstance(value, bool):
                yield f"--{'' if value else 'no-'}{name}"
            else:
                yield from (f"--{name}", str(value))
