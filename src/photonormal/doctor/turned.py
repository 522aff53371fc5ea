"""Pictures that are turned against the others, as by a program that saved some as viewers show them.

A camera that looks down notes at random how it is held. Pictures are laid on one of them as in `motion`, each at
whichever turn fits best. Those at another turn than most are reported if the others explain them far better once they
are turned back. What is turned is the frame, so that only what lies evenly about its middle is looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from photonormal.doctor.finding import Finding, counted
from photonormal.doctor.laid import Pictures, can_tell, laid_in_turn, lay_otherwise
from photonormal.types import a_few


def turns(shown: Pictures) -> Int[np.ndarray, " n"]:
    """Quarter turns, counter-clockwise, of each picture against most of the others; 0 where they are not certain.

    Of pictures that are not square half a turn alone can be.
    """
    detail, n = shown.detail, len(shown.detail)
    tried = range(4) if detail.shape[1] == detail.shape[2] else (0, 2)
    A = np.stack([np.rot90(shown.core, -k, (1, 2)).reshape(n, -1) for k in tried])  # (k, n, q), as if turned by k
    at = np.array(tried)[_laid(A)]
    count = np.bincount(at, minlength=4)
    usual = max(np.flatnonzero(count == count.max()).tolist(), key=lambda k: (at == k)[: n // 2].sum())
    found = (at - usual) % 4
    group = found > 0
    if not group.any() or 2 * group.sum() > n:
        return np.zeros(n, int)
    often = int(np.bincount(found[group]).argmax())
    put_back, moved = (_turned_back(shown, k) for k in (found, np.where(group, 0, -often)))
    return found if lay_otherwise(shown, put_back, moved, group) < 0 else np.zeros(n, int)


def _turned_back(shown: Pictures, quarters: Int[np.ndarray, " n"]) -> Pictures:
    return replace(shown, detail=np.stack([np.rot90(d, -k) for d, k in zip(shown.detail, quarters, strict=True)]))


def about(
    pictures: Float[np.ndarray, "n a b"], middle: tuple[float, float], square: bool
) -> Float[np.ndarray, "n c d"]:
    """What lies evenly about the frame's `middle` (row, column); where the frame is `square` a square of it."""
    sizes = [max(0, int(2 * min(m + 0.5, size - m - 0.5))) for m, size in zip(middle, pictures.shape[1:], strict=True)]
    if square:
        sizes = [min(sizes)] * 2
    rows, columns = (slice(k := round(m + 0.5 - size / 2), k + size) for m, size in zip(middle, sizes, strict=True))
    return pictures[:, rows, columns]


def _laid(A: Float[np.ndarray, "k n q"]) -> Int[np.ndarray, " n"]:
    """Which of the k versions of each picture fits those that were laid before."""
    size = (A[0] ** 2).sum(1).clip(1e-9)
    alike = np.max([(A[0] @ turned.T) ** 2 for turned in A], axis=0) / np.outer(size, size)

    def like(rest: Sequence[int], u: Float[np.ndarray, " q"]) -> Float[np.ndarray, "m k"]:
        return (A[:, rest] @ u.astype(np.float32)).T ** 2

    return laid_in_turn(alike, np.tile(size[:, None], len(A)), lambda j, k: A[k, j], like)


def turned(
    pictures: Float[np.ndarray, "n a b"], middle: tuple[float, float], square: bool, names: list[str]
) -> list[Finding]:
    """Pictures that are turned by quarters of a turn about the frame's `middle` (row, column)."""
    pictures = about(pictures, middle, square)
    if not can_tell(pictures):
        return []
    found = turns(Pictures.of(pictures))
    group = np.flatnonzero(found).tolist()
    if not group:
        return []
    degrees = " and ".join(str(90 * k) for k in np.unique(found[group]))
    message = (
        f"{counted(len(group), 'picture is', 'pictures are')} turned by {degrees} degrees against the others "
        f"({a_few([names[j] for j in group])}); export all pictures as the camera's sensor saw them, without Exif's "
        "orientation."
    )
    return [Finding("turned", True, message, {"turns_deg": {names[j]: int(90 * found[j]) for j in group}})]
