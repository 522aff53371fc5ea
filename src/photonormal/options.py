"""Kinds of option values, and the one check of them: commands and methods are dataclasses whose fields have a kind."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from photonormal.errors import InputError

LARGEST = 10**9

Count = Annotated[int, Meta(ge=1, le=LARGEST, description="a whole number of at least 1")]
Effort = Annotated[int, Meta(ge=1, le=100_000, description="a whole number from 1 to 100000")]
Degree = Annotated[int, Meta(ge=1, le=8, description="a whole number from 1 to 8")]
Whole = Annotated[int, Meta(ge=0, le=LARGEST, description="a whole number of at least 0")]
Seed = Annotated[int, Meta(ge=0, lt=2**31, description="a whole number from 0 to 2147483647")]
Port = Annotated[int, Meta(ge=0, lt=2**16, description="a whole number from 0 to 65535")]
Positive = Annotated[float, Meta(gt=0, description="a finite number above 0")]
NotNegative = Annotated[float, Meta(ge=0, description="a finite number of at least 0")]
Coordinate = Annotated[float, Meta(ge=-LARGEST, le=LARGEST, description="a finite number of pixels")]
Scale = Annotated[float, Meta(gt=0, le=1, description="a number above 0 and at most 1")]
Share = Annotated[float, Meta(ge=0, le=1, description="a number from 0 to 1")]
Angle = Annotated[float, Meta(gt=0, le=180, description="degrees above 0 and up to 180")]
Device = Annotated[str, Meta(pattern=r"^(auto|cpu|cuda(:\d{1,3})?)$", description="auto, cpu or cuda")]
Rotations = Annotated[Literal[1, 4], Meta(description="1 or 4, as quarter turns keep the pixels,")]
Turns = Annotated[int, Meta(ge=1, le=36, description="a whole number from 1 to 36")]
Frame = Annotated[
    Literal["opengl", "directx", "y-down", "z-away", "blender"],
    Meta(description="opengl, directx, y-down, z-away or blender"),
]
DrawnOn = Annotated[Literal["", "stored", "shown"], Meta(description="stored or shown")]
LightsFrom = Annotated[Literal["given", "refined", "unknown"], Meta(description="given, refined or unknown")]
Precision = Annotated[Literal["auto", "float32", "bf16"], Meta(description="auto, float32 or bf16")]


def check_fields(options: Any, called: Callable[[str], str]) -> None:
    """Every field of a dataclass against its kind, those of dataclasses in it, too.

    Parameters
    ----------
    called : from a field's name to what the user calls it

    Raises
    ------
    InputError
        At the first value that makes no sense: what came, and what is needed.
    """
    kinds = get_type_hints(type(options), include_extras=True)
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            check_fields(value, called)
        else:
            check_value(value, kinds[field.name], called(field.name))


def check_value(value: Any, kind: Any, called: str) -> None:
    """One value against its kind; numbers are finite, whatever the kind."""
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        needed = _meaning(kind) or _plainly(kind) or str(error).removeprefix("Expected ").split(", got")[0]
    else:
        needed = "" if not isinstance(value, float) or math.isfinite(value) else _meaning(kind) or "a finite number"
    if needed:
        raise InputError(f"{called} {str(value)[:60]} came but {needed} is needed.")


def _plainly(kind: Any) -> str:
    """What a number is called that may be left out; "" for other kinds."""
    kind = kind.__origin__ if get_origin(kind) is Annotated else kind
    return {(float, type(None)): "a number", (int, type(None)): "a whole number"}.get(get_args(kind), "")


def _meaning(kind: Any) -> str:
    """What a kind says of itself, also where it is one of several."""
    if kind is bool:
        return "true or false"
    for part in get_args(kind):
        found = part.description if isinstance(part, Meta) else _meaning(part)
        if found:
            return found
    return ""
