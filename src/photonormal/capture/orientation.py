"""Masks that were drawn on photographs as viewers show them: turned by what Exif says of how the camera was held.

Pictures stay as the sensor saw them, since lights are given in its frame and such notes change between pictures when a
camera looks down. So a mask is turned back to them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from photonormal.capture.exif import read_exif
from photonormal.capture.images import ImageFiles, Picture, parts, read_mask, size_of

BACK: dict[int, Callable[[np.ndarray], np.ndarray]] = {  # Exif's orientation -> from what is shown to what is stored
    2: np.fliplr,
    3: lambda shown: np.rot90(shown, 2),
    4: np.flipud,
    5: np.transpose,
    6: np.rot90,
    7: lambda shown: np.rot90(shown, 2).T,
    8: lambda shown: np.rot90(shown, -1),
}
PICTURES = 4  # that tell which way round a mask was drawn
WORDS = {2: "mirrored", 3: "turned by 180 degrees", 4: "upside down and mirrored", 5: "turned and mirrored"}
WORDS |= {6: "turned by 90 degrees", 7: "turned and mirrored", 8: "turned by 90 degrees"}


def read_drawn(path: Path, pictures: Sequence[Picture]) -> tuple[Bool[np.ndarray, "h w"], list[str]]:
    """The mask of a file as the pictures' samples lie, and a note where Exif's orientation left a choice.

    Of two ways in which it has their size it is the one that parts what they show better.
    """
    frame = size_of(pictures[0])
    orientations = sorted({read_exif(parts(p)[0]).orientation for p in pictures} - {1})
    if not orientations:
        return read_mask(path, frame), []
    size = size_of(path)
    mask = read_mask(path, size if size == frame[::-1] else frame)
    ways = {o: m for o, m in {1: mask, **{o: BACK[o](mask) for o in orientations}}.items() if m.shape == frame}
    if not ways:
        return read_mask(path, frame), []  # which refuses it
    best = next(iter(ways))
    if any(not np.array_equal(m, ways[best]) for m in ways.values()):
        level = _brightest(pictures[:: max(1, len(pictures) // PICTURES)])
        best = max(ways, key=lambda o: _parted(level, ways[o]))
    elif best == 1:
        return mask, []
    how = f"was drawn on pictures as viewers show them, {WORDS[best]}, and was turned back" if best > 1 else ""
    how = how or f"was used as it is, though viewers show the pictures {WORDS[orientations[0]]}"
    note = f"Exif's orientation: the mask {how}; results and lights lie as the camera's sensor saw the object."
    return np.ascontiguousarray(ways[best]), [note]


def _brightest(pictures: Sequence[Picture]) -> Float[np.ndarray, "h w"]:
    files = ImageFiles(pictures, None, np.ones((len(pictures), 1)))
    return np.max([files.decoded(j).mean(-1) for j in range(len(pictures))], axis=0)


def _parted(grey: np.ndarray, mask: np.ndarray) -> float:
    """Variance between the inside of a mask and the outside."""
    inside = float(mask.mean())
    if not 0 < inside < 1:
        return 0.0
    return inside * (1 - inside) * float(grey[mask].mean() - grey[~mask].mean()) ** 2
