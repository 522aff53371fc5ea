"""How the samples of photographs are encoded, by what the files say, and how they become linear."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from photonormal.capture.exif import Exif
from photonormal.files.decode import RAW
from photonormal.files.embedded import embedded
from photonormal.files.icc import gamma, read_profile
from photonormal.srgb import to_linear
from photonormal.types import InputError, a_few

ADOBE = 563 / 256  # exponent of Adobe RGB (1998)
CLOSE = 0.003  # difference of curves that have one name
Curve = Callable[[np.ndarray], np.ndarray]  # samples in [0, 1] -> linear radiance in [0, 1]
STEPS = np.linspace(0, 1, 1025)


@dataclass(frozen=True)
class Encoding:
    """Curves that make samples linear, one for each channel or one for all; none: they are.

    Parameters
    ----------
    by : what says so, for reports
    declared : the file says so, or the user
    by_user : the user says so, of all files
    """

    curves: tuple[Curve, ...] = ()
    by: str = "nothing in the files says otherwise"
    declared: bool = True
    by_user: bool = False

    @property
    def name(self) -> str:
        """linear, sRGB, or gamma with its exponent."""
        if not self.curves:
            return "linear"
        y = self.curves[len(self.curves) // 2](STEPS)
        if np.abs(y - to_linear(STEPS)).max() < CLOSE:
            return "sRGB"
        exponent = float(np.log(y[512].clip(1e-6)) / np.log(0.5))
        return f"gamma {exponent:.2g}" if np.abs(y - STEPS**exponent).max() < CLOSE else "a tone curve"

    def linear(self, samples: np.ndarray, channel: int | None = None) -> np.ndarray:
        """Linear radiance in [0, 1], float32, of unsigned samples (..., c), or of the one `channel` of three."""
        levels = np.iinfo(samples.dtype).max + 1
        curves = self.curves
        if channel is not None or samples.shape[-1] == 1:
            curves = (curves[(1 if channel is None else channel) % len(curves)],)
        if len(curves) == 1:
            return _table(curves[0], levels)[samples]
        return np.stack([_table(curve, levels)[samples[..., k]] for k, curve in enumerate(curves)], axis=-1)


@lru_cache(maxsize=16)
def _table(curve: Curve, levels: int) -> np.ndarray:
    return curve(np.arange(levels) / (levels - 1)).astype(np.float32)


LINEAR = Encoding(declared=False)
JPEG = Encoding(by="nothing in these JPEG files says otherwise", declared=False)
UNREAD = Encoding(by="their profile has no tone curves and was not applied", declared=False)


def encoding_of(path: Path) -> Encoding:
    """What a file says of itself: its profile counts before PNG's sRGB, and that before Exif's colour space."""
    if path.suffix.lower() in RAW:
        return Encoding(by="RAW files are")
    said = embedded(path)
    profile = read_profile(said.profile) if said.profile else None
    if profile is not None:
        straight = all(np.abs(curve(STEPS) - STEPS).max() < CLOSE / 3 for curve in profile.curves)
        return Encoding(() if straight else profile.curves, f"the profile {profile.name or 'in the files'}")
    exif = Exif.of(said)
    if said.srgb or exif.colour_space == "sRGB":
        return Encoding((to_linear,), "PNG's sRGB" if said.srgb else "Exif")
    if exif.colour_space == "Adobe RGB":
        return Encoding((gamma(ADOBE),), "Exif, which says Adobe RGB")
    if said.profile is not None:
        return UNREAD
    return JPEG if said.jpeg else LINEAR


def encodings(paths: Sequence[Path], srgb: bool = False, linear: bool = False) -> list[Encoding]:
    """Of every file, or what the user says of them all.

    Raises
    ------
    InputError
        If the user says both, or some files say how they are encoded and others don't.
    """
    if srgb and linear:
        raise InputError("--srgb came with --linear but the photographs are either; drop one.")
    if srgb or linear:
        said = Encoding((to_linear,), "--srgb", by_user=True) if srgb else Encoding(by="--linear", by_user=True)
        return [Encoding(by="RAW files are") if path.suffix.lower() in RAW else said for path in paths]
    found = [encoding_of(path) for path in paths]
    silent = [path.name for path, e in zip(paths, found, strict=True) if not e.declared]
    encoded = [e for e in found if e.curves]
    if silent and encoded:
        raise InputError(
            f"{a_few(silent, 1)} don't say how they are encoded but {len(encoded)} others are {encoded[0].name} (by "
            f"{encoded[0].by}); add --srgb if all are sRGB-encoded or --linear if none is encoded, or export all alike."
        )
    return found


def doubtful(found: Sequence[Encoding]) -> list[str]:
    """What the user should know: profiles that can't be applied, and JPEG files that say nothing."""
    unread, silent = sum(e is UNREAD for e in found), sum(e is JPEG for e in found)
    notes = []
    if unread:
        notes.append(
            f"the colour profile of {unread} photographs has no tone curves that can be read, so it was not applied; "
            "export them with sRGB's profile or a linear one, or add --srgb or --linear."
        )
    if silent:
        notes.append(
            f"{silent} photographs are JPEG files that don't say how they are encoded. They were taken for linear, "
            "which JPEG files seldom are; add --srgb, or --linear if they are linear."
        )
    return notes


def encoding_told(found: Sequence[Encoding]) -> str:
    """A line for reports, such as "sRGB (Exif)"; the number of pictures where they differ."""
    counts = Counter(f"{e.name} ({e.by})" for e in found)
    if len(counts) == 1:
        return next(iter(counts))
    return ", ".join(f"{count} pictures {line}" for line, count in counts.items())
