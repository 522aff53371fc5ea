"""Pictures that are shifted against the others: a camera or an object that moved.

What a picture should show is told by the others, whatever the lights: pictures of a matt surface are combinations of
three, of others of few more. A picture that moved is such a combination only after it is shifted back. How well it is
one is asked at every shift, so that the combination is not spoilt by where the picture lies.

One picture alone says little: what repeats, as threads of a weave do, fits elsewhere, too, and so do highlights. So it
is judged by how well the pictures of this object fit as a rule. A highlight or the rim of a shadow moves by itself, a
picture as a whole: all of its parts have to fit better.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from photonormal.doctor.finding import Finding, listed

SIZE = 32  # pixels of the smaller side, at least
FARTHEST = 12  # pixels of a shift looked for, and at most this part of the smaller side
PART = 5
RANK = 8  # pictures that the others are combined of
LEAST = 6  # pictures
DETAIL = 3.0  # pixels: coarser shading moves with the light
SIDE, AGREED = 6, 2.2  # parts along each side, and standard errors by which they fit better after the shift
UNEXPLAINED = 0.8  # of a picture's detail after the shift, as part of before, below which it may have moved
OUTLYING = 2.0  # robust standard deviations by which it fits worse than the pictures do as a rule, in log odds


@dataclass(frozen=True)
class Pictures:
    """Detail of `n` pictures, and of their middles, which stay inside at every shift by up to `reach` pixels."""

    detail: Float[np.ndarray, "n a b"]
    reach: int

    @classmethod
    def of(cls, pictures: Float[np.ndarray, "n a b"]) -> Pictures:
        """Finer than shading, of which the square root is taken so that bright parts don't count alone."""
        import cv2

        seen = np.sqrt((pictures / max(float(np.quantile(pictures, 0.99)), 1e-9)).clip(0, 1.4)).astype(np.float32)
        detail = np.stack([picture - cv2.GaussianBlur(picture, (0, 0), DETAIL) for picture in seen])
        return cls(detail, min(FARTHEST, min(pictures.shape[1:]) // PART))

    @cached_property
    def core(self) -> Float[np.ndarray, "n c d"]:
        r = self.reach
        return self.detail[:, r:-r, r:-r]

    @cached_property
    def gram(self) -> Float[np.ndarray, "n n"]:
        """Of the middles."""
        A = self.core.reshape(len(self.core), -1)
        return A @ A.T

    def principal(self, among: Bool[np.ndarray, " n"], j: int) -> Float[np.ndarray, "k q"]:
        """Orthonormal pictures that those `among` them but j are combined of, `q` pixels of the middle each."""
        others = np.flatnonzero(among & (np.arange(len(among)) != j))
        w, V = np.linalg.eigh(self.gram[np.ix_(others, others)])
        w, V = w[-RANK:].clip(1e-9), V[:, -RANK:]
        return ((V / np.sqrt(w)).T @ self.core[others].reshape(len(others), -1)).astype(np.float32)

    def unexplained(self, among: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "n 2r+1 2r+1"]:
        """Part of each picture's detail, shifted by up to r pixels, that those of the others `among` them don't show.

        Rows of the shifts count downwards, columns to the right; the middle one is none.
        """
        import cv2

        n, r, size = len(self.detail), self.reach, self.core.shape[1:]
        left = np.ones((n, 2 * r + 1, 2 * r + 1))
        for j in range(n):
            parts = [u.reshape(size) for u in self.principal(among, j)]
            shown = sum(cv2.matchTemplate(self.detail[j], u, cv2.TM_CCORR) ** 2 for u in parts)
            whole = cv2.matchTemplate(self.detail[j] ** 2, np.ones(size, np.float32), cv2.TM_CCORR)
            left[j] = 1 - shown / whole.clip(1e-9)
        return left.clip(1e-6, 1)

    def agreed(self, among: Bool[np.ndarray, " n"], j: int, y: int, x: int) -> bool:
        """Whether picture j fits better in all its parts, as a rule, where the shift at row y and column x is taken."""
        U, (h, w) = self.principal(among, j), self.core.shape[1:]
        part = (np.arange(h) * SIDE // h)[:, None] * SIDE + np.arange(w) * SIDE // w

        def rest(y: int, x: int) -> Float[np.ndarray, " k"]:
            A = self.detail[j, y : y + h, x : x + w].ravel()
            return np.bincount(part.ravel(), (A - (U @ A) @ U) ** 2)

        change = np.log((rest(y, x) + 1e-9) / (rest(self.reach, self.reach) + 1e-9))
        return bool(-change.mean() > AGREED * (change.std() / SIDE + 1e-3))


def shifts(pictures: Float[np.ndarray, "n a b"]) -> Float[np.ndarray, "n 2"]:
    """Shift (x right, y down) in pixels of each picture against what the others show; 0 where it is not certain."""
    n, shown = len(pictures), Pictures.of(pictures)
    found, everything = np.zeros((n, 2)), np.ones(n, bool)
    suspect = _suspect(shown.unexplained(everything))
    if 2 * suspect.sum() >= n or n - suspect.sum() < LEAST - 1 or not suspect.any():
        return found
    among, left, r = ~suspect, shown.unexplained(~suspect), shown.reach
    suspect, odds = _suspect(left), np.log(left[:, r, r] / (1 - left[:, r, r]).clip(1e-6))
    from_usual = odds - np.median(odds)
    for j in np.flatnonzero(suspect & (from_usual > OUTLYING * 1.4826 * np.median(np.abs(from_usual)))).tolist():
        y, x = (int(v) for v in np.unravel_index(int(left[j].argmin()), left[j].shape))
        if not shown.agreed(among, j, y, x):
            continue
        found[j] = x - r + _dip(left[j][y, x - 1 : x + 2]), y - r + _dip(left[j][y - 1 : y + 2, x])
    return found


def _suspect(left: Float[np.ndarray, "n k k"]) -> Bool[np.ndarray, " n"]:
    """Pictures that fit clearly better elsewhere, not at the border of what was tried."""
    r = left.shape[1] // 2
    inside = left[:, 1:-1, 1:-1].min((1, 2))
    return (inside < UNEXPLAINED * left[:, r, r]) & (inside <= left.min((1, 2)))


def motion(pictures: Float[np.ndarray, "n a b"], scale: float, names: list[str]) -> list[Finding]:
    """Pictures that moved; `scale` is that of `pictures` against the photographs."""
    if min(pictures.shape[1:]) < SIZE or len(pictures) < LEAST or not pictures.any():
        return []
    shift = shifts(pictures) / scale
    moved = np.flatnonzero(np.abs(shift).max(1) > 0)
    if not moved.size:
        return []
    moved = moved[np.argsort(-np.linalg.norm(shift[moved], axis=1))]
    text = listed([f"{names[j]} by ({shift[j, 0]:+.1f}, {shift[j, 1]:+.1f}) px" for j in moved])
    return [
        Finding(
            "motion",
            True,
            f"{len(moved)} pictures are shifted against the others ({text}; right and down are positive); align them, "
            "or leave them out and fix camera and object.",
            {"shifts_px": {names[j]: [round(float(v), 2) for v in shift[j]] for j in moved}},
        )
    ]


def _dip(values: np.ndarray) -> float:
    """Where the parabola through three values has its ground, from the middle one."""
    before, at, after = (float(v) for v in values)
    return 0.5 * (before - after) / max(before - 2 * at + after, 1e-9)
