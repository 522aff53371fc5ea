"""What the command line says when an option can't be understood, and when photonormal itself fails: one line each."""

from __future__ import annotations

import os
import platform
import re
import sys
import tempfile
import traceback

import photonormal
from photonormal.errors import code_of_others, no_such

LONGEST = 300  # characters of a line
NO_NUMBER = (  # of an option that must be one, or may be left out
    r"(?:could not convert string to float: |(invalid literal)[^']*|no type matching \{None\}\|(FLOAT|INT) could be "
    r"instantiated from \[)'(.*?)'"
)


def one_line(box: str, command: str = "") -> str:
    """What a box of tyro's about wrong options of a command says: what it names and what it suggests, without all of
    the help. Of an option that only other commands have it says which."""
    lines = [line[2:].rstrip(" │") for line in box.splitlines()[1:]]  # the first is a title, the border may be blank
    parts = re.split(r"\n*[─-]{4,}[╯\n]*", "\n".join(lines).strip("\n"))
    said, meant = [], ""
    for part in parts:
        brief = " ".join(line.strip() for line in part.splitlines() if not line.startswith(" " * 8))
        if brief.startswith("Perhaps you meant"):
            meant = "".join(f"; perhaps {option} is meant" for option in re.findall(r"--[\w-]+", brief)[:1])
        elif brief and not brief.startswith(("Argument helptext", "For full helptext")):
            said.append(re.sub(r" *\(required\)|[.: ]+$", "", brief))
    see = re.search(r"photonormal[\w ]* --help", " ".join(box.replace("│", "").split()))
    told = "; ".join(said)
    if wrong := re.match(rf"Error parsing (\S+): {NO_NUMBER}", told):
        needed = "a whole number" if wrong[2] or wrong[3] == "INT" else "a number"
        return f"{wrong[1]} {wrong[4][:LONGEST]!r} came but {needed} is needed; correct it."
    if choice := re.match(r"invalid choice '(.*)' for argument '(--[\w-]+)'. Expected one of \((.*)\)", told):
        return str(no_such(choice[2], choice[1], filter(None, re.findall(r"'([^']*)'", choice[3]))))
    if unknown := re.match(r"Unrecognized options: ([^-,;][^,;]*).*; Available subcommands: (.*)", told):
        return str(no_such("command", unknown[1], unknown[2].split(", ")))
    own = f"photonormal {command} --help" if command else "photonormal --help"
    if other := re.match(r"Unrecognized or misplaced options: (--[\w-]+) \(applied to (photonormal \w+)\)", told):
        if there := _commands_with(other[1], lines):
            have = "have" if there[1:] else "has"
            return f"{other[2]} has no option {other[1]}, but {', '.join(there)} {have}; see {own}."
        told = f"Unrecognized options: {other[1]}"
    message = re.sub(r"^Error parsing (\S+): ", r"\1 can't be understood: ", told) or "wrong options"
    return f"{message[:LONGEST]}{meant}; see {see.group() if see and see.group() != 'photonormal --help' else own}."


def _commands_with(option: str, lines: list[str]) -> list[str]:
    """The commands that a box of tyro's names below the option."""
    found, below = set(), ""
    for line in lines:
        words = line.split()
        if words[:1] and words[0].startswith("--"):
            below = words[0]
        elif below == option and words[:2] == ["in", "photonormal"]:
            found.add(words[2])
    return sorted(found)


def fault(error: Exception, arguments: list[str] | None) -> str:
    """A line about an error that is no user's, which names a file that holds what is needed to find its cause."""
    what = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
    words = sys.argv[1:] if arguments is None else [str(a) for a in arguments]
    lines = [
        f"photonormal {photonormal.__version__}, Python {platform.python_version()}, {platform.platform()}",
        f"options: {words!r}",
        "",
        *traceback.format_exception(error),
    ]
    try:
        file, path = tempfile.mkstemp(prefix="photonormal-fault-", suffix=".txt")
        with os.fdopen(file, "w", encoding="utf-8", errors="backslashreplace") as opened:
            opened.write("\n".join(lines))
    except OSError:
        path = ""
    if place := code_of_others(error):
        return (
            f"{what}, raised in {place}, which is no part of photonormal{f'; the traceback is in {path}' * bool(path)}."
        )
    return f"{what}; this is a fault of photonormal, not yours: please report it{f' with {path}' * bool(path)}."
