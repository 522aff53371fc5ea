"""What was given for photographs as viewers show them: turned by what Exif says of how the camera was held.

Pictures stay as the sensor saw them, since lights are given in its frame and such notes change between pictures when a
camera looks down. So a mask is turned back to them, and of lamps in a ring it is said where their first one is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from photonormal.capture.exif import read_exif
from photonormal.capture.images import ImageFiles, Picture, files_of, picture_size, read_mask
from photonormal.options import DrawnOn, check_value
from photonormal.types import InputError

BACK: dict[int, Callable[[np.ndarray], np.ndarray]] = {  # Exif's orientation -> from what is shown to what is stored
    2: np.fliplr,
    3: lambda shown: np.rot90(shown, 2),
    4: np.flipud,
    5: np.transpose,
    6: np.rot90,
    7: lambda shown: np.rot90(shown, 2).T,
    8: lambda shown: np.rot90(shown, -1),
}
STARTS = {3: 180, 6: 90, 8: -90}  # -> degrees in what is stored at the right of what is shown
SAME, DIFFER = 0.02, 0.5  # of a mask's pixels, and of the contrast between inside and outside
PICTURES = 4  # that show which way round a mask was drawn
WORDS = {2: "mirrored", 3: "turned by 180 degrees", 4: "upside down and mirrored", 5: "turned and mirrored"}
WORDS |= {6: "turned by 90 degrees", 7: "turned and mirrored", 8: "turned by 90 degrees"}


def read_drawn(
    path: Path, pictures: Sequence[Picture], drawn_on: str = ""
) -> tuple[Bool[np.ndarray, "h w"], list[str]]:
    """The mask of a file as the pictures' samples lie, and a note where Exif's orientation left a choice.

    Parameters
    ----------
    drawn_on : "stored", the samples as they lie, or "shown", what viewers show; "": whichever fits, by its size and by
        what the pictures show where the two differ

    Raises
    ------
    InputError
        If both fit; if the mask has another size.
    """
    check_value(drawn_on, DrawnOn, "mask_on")
    frame = picture_size(pictures[0])
    turns = sorted({read_exif(files_of(p)[0]).orientation for p in pictures} - {1})
    if not turns or drawn_on == "stored":
        return read_mask(path, frame), []
    size = picture_size(path)
    mask = read_mask(path, size if size == frame[::-1] else frame)
    ways = {o: BACK[o](mask) for o in turns} if drawn_on == "shown" else {1: mask, **{o: BACK[o](mask) for o in turns}}
    ways = {o: m for o, m in ways.items() if m.shape == frame}
    if not ways:
        return read_mask(path, frame), []  # which refuses it
    best = next(iter(ways))
    if len(ways) > 1:
        level = _brightest(pictures[:: max(1, len(pictures) // PICTURES)])
        best = max(ways, key=lambda o: _parted(level, ways[o]))
        unsure = [o for o in ways if not _fits_alone(level, ways[best], ways[o])]
        if unsure:
            turn = WORDS[max(best, *unsure)]
            raise InputError(
                f"mask {path} fits the photographs as it is and {turn}, as viewers show them by Exif's orientation; "
                "say which it was drawn on with --mask-on stored or --mask-on shown."
            )
    if best == 1 and all(np.array_equal(m, mask) for m in ways.values()):
        return mask, []
    how = f"was drawn on pictures as viewers show them, {WORDS[best]}, and was turned back" if best > 1 else ""
    how = how or f"was used as it is, though viewers show the pictures {WORDS[turns[0]]}"
    note = f"Exif's orientation: the mask {how}; results and lights lie as the camera's sensor saw the object."
    return np.ascontiguousarray(ways[best]), [note]


def ring_note(pictures: Sequence[Picture]) -> list[str]:
    """What the user should know of a ring of lamps where viewers show the pictures turned."""
    turns = {read_exif(files_of(p)[0]).orientation for p in pictures}
    if len(turns) > 1 or not turns <= set(STARTS):
        return []
    turn = turns.pop()
    return [
        f"Exif's orientation: viewers show the pictures {WORDS[turn]}, but --ring and --start count in the pictures "
        f"as the camera's sensor saw them; if you counted as viewers show them, add {STARTS[turn]} to --start."
    ]


def _brightest(pictures: Sequence[Picture]) -> Float[np.ndarray, "h w"]:
    files = ImageFiles(pictures, None, np.ones((len(pictures), 1)))
    return np.max([files.decoded(j).mean(-1) for j in range(len(pictures))], axis=0)


def _parted(level: np.ndarray, mask: np.ndarray) -> float:
    """Variance between the inside of a mask and the outside."""
    inside = float(mask.mean())
    return inside * (1 - inside) * _contrast(level, mask, ~mask) ** 2


def _fits_alone(level: np.ndarray, mask: np.ndarray, other: np.ndarray) -> bool:
    """Whether what only `mask` holds differs from what only `other` holds, nearly as inside and outside do.

    So does a mask of which the other is nearly a copy.
    """
    if (mask ^ other).sum() <= SAME * mask.sum():
        return True
    return _contrast(level, mask & ~other, other & ~mask) / (_contrast(level, mask, ~mask) or np.inf) > DIFFER


def _contrast(level: np.ndarray, some: np.ndarray, others: np.ndarray) -> float:
    return float(level[some].mean() - level[others].mean()) if some.any() and others.any() else 0.0
