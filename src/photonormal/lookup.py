"""Methods, networks and figures by their places, imported only when they are asked for."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def lookup(place: str) -> Any:
    """What a place such as ``"package.module:Class"`` names.

    >>> lookup("math:tau") > 6
    True
    """
    module, name = place.split(":")
    return getattr(import_module(module), name)
