"""The methods of a benchmark: `woodham`, or `label=method:option=value`, so that one method can enter several times."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from photonormal.methods import METHODS, configure, options_of, parse
from photonormal.provenance import Made, made_by
from photonormal.types import InputError

RESERVED = ("truth",)  # folder of a run that is no method's
BY_NAME = ("irps", "dpsn")  # alone: minutes an object, or the lights of one rig


@dataclass(frozen=True)
class Entry:
    """A method with its options, under the name that tables use."""

    label: str
    method: str
    options: dict[str, Any]

    def solver(self) -> Any:
        """The method with its options."""
        return configure(self.method, **self.options)

    def config(self) -> Made:
        """What its predictions depend on: the version, all options, and digests of the weights and of the code."""
        return made_by(self.method, self.options)

    def options_as_stored(self) -> dict[str, Any]:
        """All options in JSON's kinds of values."""
        return options_of(self.solver())


def entries(text: str) -> list[Entry]:
    """Entries from ``a,b`` or ``all``, which leaves out what takes minutes an object.

    An entry is ``method``, ``label=method`` or ``label=method:option=value:...``.

    Raises
    ------
    InputError
        If a method or option does not exist, a value can't be read, or two entries have one name.
    """
    everything = [name for name in METHODS if name not in BY_NAME]
    parts = everything if text.strip() == "all" else [p.strip() for p in text.split(",") if p.strip()]
    if not parts:
        raise InputError("--methods is empty; name methods like woodham,l1, or all.")
    found = [_entry(part) for part in parts]
    labels = [e.label for e in found]
    for label in labels:
        if labels.count(label) > 1:
            raise InputError(f"two methods are called {label!r}; name each once, or apart: {label}2={label}.")
    return found


def _entry(text: str) -> Entry:
    head = re.split(r":(?=\w+=)", text)[0]
    label = head.rpartition("=")[0]
    method, options = parse(text[len(label) + 1 :] if label else text)
    label = label or method
    if not re.fullmatch(r"\w[\w.+ -]*", label) or label in RESERVED:
        raise InputError(f"a method can't be called {label!r}; use letters, digits, - and _.")
    return Entry(label, method, options)
