"""ICC profiles (specification ICC.1:2022-05): the tone curves that make samples linear.

Their matrix mixes channels that are linear already, which changes no shading: pictures keep the primaries they have.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

HEADER, MOST_TAGS = 128, 200
CURVES = {b"RGB ": (b"rTRC", b"gTRC", b"bTRC"), b"GRAY": (b"kTRC",)}  # tags by the profile's colour space
PARAMETERS = (1, 3, 4, 5, 7)  # of each kind of parametric curve: g, a, b, c, d, e, f


@dataclass(frozen=True)
class Curve:
    """Linear light of a sample x: ``(a x + b)^g + e`` from d on, ``c x + f`` below; or equal steps of a table.

    One of `parameters` (g, a, b, c, d, e, f) and `table` is empty.
    """

    parameters: tuple[float, ...] = ()
    table: tuple[float, ...] = ()

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Linear light in [0, 1], 1 for 1, of samples x in [0, 1]."""
        with np.errstate(all="ignore"):  # of the branch that is not taken
            return (self._raw(x) / self._raw(np.ones(1))[0]).clip(0, 1)

    def _raw(self, x: np.ndarray) -> np.ndarray:
        if self.table:
            return np.interp(x, np.linspace(0, 1, len(self.table)), self.table)
        g, a, b, c, d, e, f = self.parameters
        return np.where(x >= d, np.maximum(a * x + b, 0) ** g + e, c * x + f)


def gamma(exponent: float) -> Curve:
    """x^exponent."""
    return Curve((exponent, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Profile:
    """A profile's name, and a curve for each channel, or for all."""

    name: str
    curves: tuple[Curve, ...]


@lru_cache(maxsize=16)
def read_profile(data: bytes) -> Profile | None:
    """The tone curves of a profile of grey levels or RGB; None where it has none, as a printer's, or is damaged."""
    try:
        tags = _tags(data)
        curves = tuple(_curve(tags[name]) for name in CURVES[data[16:20]])
        if not all(_rises(curve) for curve in curves):
            return None
        return Profile(_name(tags.get(b"desc", b"")), curves[:1] if len(set(curves)) == 1 else curves)
    except (KeyError, struct.error, ValueError, IndexError, OverflowError):
        return None


def _tags(data: bytes) -> dict[bytes, bytes]:
    if data[36:40] != b"acsp":
        raise ValueError("no profile")
    count = struct.unpack_from(">I", data, HEADER)[0]
    tags = {}
    for k in range(min(count, MOST_TAGS)):
        name, at, size = struct.unpack_from(">4sII", data, HEADER + 4 + 12 * k)
        tags[name] = data[at : at + size]
    return tags


def _curve(tag: bytes) -> Curve:
    if tag[:4] == b"para":
        kind = struct.unpack_from(">H", tag, 8)[0]
        return _parametric(kind, [v / 65536 for v in struct.unpack_from(f">{PARAMETERS[kind]}i", tag, 12)])
    if tag[:4] != b"curv":
        raise ValueError("no tone curve")
    count = struct.unpack_from(">I", tag, 8)[0]
    if count > 65536:
        raise ValueError("too long a curve")
    values = struct.unpack_from(f">{count}H", tag, 12)
    if count < 2:
        return gamma(values[0] / 256 if count else 1.0)
    return Curve(table=tuple(v / 65535 for v in values))


def _rises(curve: Curve) -> bool:
    y = curve(np.linspace(0, 1, 257))
    return bool(np.isfinite(y).all() and (np.diff(y) >= -1e-6).all() and y[-1] > y[0])


def _parametric(kind: int, p: list[float]) -> Curve:
    """The seven parameters of any kind of parametric curve."""
    if kind == 0:
        return gamma(p[0])
    if kind < 3:  # a constant below -b / a
        g, a, b, c = [*p, 0.0][:4]
        return Curve((g, a, b, 0.0, -b / a if a else 0.0, c, c))
    g, a, b, c, d, e, f = [*p, 0.0, 0.0][:7]
    return Curve((g, a, b, c, d, e, f))


def _name(tag: bytes) -> str:
    """What a profile calls itself, in ASCII or the first of its languages."""
    if tag[:4] == b"desc":
        length = struct.unpack_from(">I", tag, 8)[0]
        return tag[12 : 12 + length].split(b"\0")[0].decode("ascii", "replace")[:80]
    if tag[:4] == b"mluc":
        length, at = struct.unpack_from(">II", tag, 20)
        return tag[at : at + length].decode("utf-16-be", "replace").strip("\0")[:80]
    return ""
