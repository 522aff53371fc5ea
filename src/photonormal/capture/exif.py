"""What a camera wrote about a picture: exposure, colour space, and how it was held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.files.embedded import Embedded, embedded
from photonormal.types import InputError, a_few

EXPOSURE, F_NUMBER, ISO, ORIENTATION = 0x829A, 0x829D, 0x8827, 0x0112
COLOUR_SPACE, INTEROPERABILITY_INDEX = 0xA001, 0x0001
UNEQUAL = 1.1  # times the least exposure, above which pictures are brighter by more than lamps differ


@dataclass(frozen=True)
class Exif:
    """Exposure time in seconds, f-number, ISO speed, each None where it was not written.

    `colour_space` is "sRGB", "Adobe RGB" or "", `orientation` how viewers turn the picture, 1 (not at all) to 8.
    """

    exposure_s: float | None = None
    f_number: float | None = None
    iso: float | None = None
    colour_space: str = ""
    orientation: int = 1

    @staticmethod
    def of(found: Embedded) -> Exif:
        """What a file's tags say."""
        space, index = found.number(COLOUR_SPACE), found.tags.get(INTEROPERABILITY_INDEX)
        adobe = space == 2 or (space == 0xFFFF and isinstance(index, bytes) and index.startswith(b"R03"))
        orientation = int(found.number(ORIENTATION) or 1)
        return Exif(
            found.number(EXPOSURE),
            found.number(F_NUMBER),
            found.number(ISO),
            "sRGB" if space == 1 else "Adobe RGB" if adobe else "",
            orientation if 1 <= orientation <= 8 else 1,
        )

    def exposure(self) -> float | None:
        """t ISO / (100 N^2): what scales a picture's brightness; None without an exposure time."""
        if not self.exposure_s:
            return None
        return self.exposure_s * (self.iso or 100) / 100 / (self.f_number or 1) ** 2


def read_exif(path: Path) -> Exif:
    """What Exif says; nothing where a file has none or a damaged one."""
    return Exif.of(embedded(path))


def exposures_told(paths: Sequence[Path]) -> list[str]:
    """What the user should know where the camera exposed pictures differently, which nothing was divided by."""
    try:
        e = exposures(paths)[:, 0]
    except InputError:  # they can't be compared
        return []
    least, most = int(e.argmin()), int(e.argmax())
    if e[most] < UNEQUAL * e[least]:
        return []
    return [
        f"the camera exposed the photographs differently: {paths[most].name} {e[most] / e[least]:.2g} times as much as "
        f"{paths[least].name}, by their Exif data. Add --exif-exposure, which divides by that, unless flashes lit the "
        "object."
    ]


def exposures(paths: Sequence[Path]) -> np.ndarray:
    """Exposures (n, 1) of the pictures by their Exif, their mean 1.

    Raises
    ------
    InputError
        If a picture has none, or some state ISO or f-number and others don't.
    """
    found = [read_exif(p) for p in paths]
    absent = [p.name for p, e in zip(paths, found, strict=True) if e.exposure() is None]
    if absent:
        raise InputError(
            f"{a_few(absent, 1)} have no exposure time in their Exif data but --exif-exposure needs it; "
            "give light_intensities.txt instead, or the pictures as the camera wrote them."
        )
    for what in ("iso", "f_number"):
        if len({getattr(e, what) is None for e in found}) == 2:
            raise InputError(
                f"some pictures name their {what.replace('_', '-')} in Exif and others don't, so exposures can't "
                "be compared; give light_intensities.txt instead."
            )
    e = np.array([[x.exposure()] for x in found], dtype=np.float64)
    return e / e.mean()
