"""Pictures laid on one another: how much of each the others explain, and groups that lie otherwise.

The other pictures say what a picture should show, whatever the lights: pictures of a matt surface are combinations of
three, of others of few more. A picture that lies otherwise is such a combination only after it is put back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

SIZE = 32  # pixels of the smaller side, at least
FARTHEST = 12  # pixels of a shift looked for, and at most this part of the smaller side
PART = 5
RANK = 8  # pictures that the others are combined of
MANY = 96  # others that show these, and groups; of more, every so many, since the time grows with their cube
LEAST = 6  # pictures
DETAIL = 3.0  # pixels: coarser shading moves with the light
SIDE, AGREED = 6, 2.2  # parts along each side, and standard errors by which they fit better after the shift
LOST, TOGETHER = 0.05, 0.75  # of a group's detail that the others don't explain as it lies, and of that once put back
REPEATS, PLAINLY = 0.4, 0.1  # of what the others explain of one another, that they do once moved like the group: more
# is what repeats, or looks alike when turned; and of that what is left of such a group's detail
STILL = 0.5  # of what it fits worse by than they do, that is left once it is put back


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

    def at(self, j: int, y: int, x: int) -> Float[np.ndarray, "c d"]:
        """What of picture j lies on the middle where it is laid with its row y and column x there."""
        h, w = self.core.shape[1:]
        return self.detail[j, y : y + h, x : x + w]

    def principal(self, among: Bool[np.ndarray, " n"], j: int, rank: int = RANK) -> Float[np.ndarray, "k q"]:
        """Orthonormal pictures that those `among` them but j are combined of, `q` pixels of the middle each."""
        others = at_most(np.flatnonzero(among & (np.arange(len(among)) != j)), MANY)
        w, V = np.linalg.eigh(self.gram[np.ix_(others, others)])
        w, V = w[-rank:].clip(1e-9), V[:, -rank:]
        return ((V / np.sqrt(w)).T @ self.core[others].reshape(len(others), -1)).astype(np.float32)

    def unexplained(self, among: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "n 2r+1 2r+1"]:
        """Part of each picture's detail, shifted by up to r pixels, that those of the others `among` them don't show.

        Rows of the shifts count downwards, columns to the right; the middle one is none.
        """
        return np.stack([self.left(j, self.principal(among, j)) for j in range(len(self.detail))])

    def left(self, j: int, U: Float[np.ndarray, "k q"]) -> Float[np.ndarray, "2r+1 2r+1"]:
        """Part of picture j's detail, at every shift, that U does not show."""
        shown = sum(self._like(j, u.reshape(self.core.shape[1:])) for u in U)
        return (1 - shown / self._whole(j)).clip(1e-6, 1)

    def _like(self, j: int, u: Float[np.ndarray, "c d"]) -> Float[np.ndarray, "k k"]:
        """How much of picture j, at every shift, is like u."""
        import cv2

        return cv2.matchTemplate(self.detail[j], u.astype(np.float32), cv2.TM_CCORR) ** 2

    def _whole(self, j: int) -> Float[np.ndarray, "k k"]:
        """All detail of picture j, at every shift."""
        import cv2

        return cv2.matchTemplate(self.detail[j] ** 2, np.ones(self.core.shape[1:], np.float32), cv2.TM_CCORR).clip(1e-9)

    def laid_together(self) -> Int[np.ndarray, "n 2"]:
        """Shift (down, right) of each picture against one, where those that were laid on it before explain it best.

        Pictures under other lights look alike to a few of them; so the one that fits best is always laid next.
        """
        alike = self.gram**2 / np.outer(np.diag(self.gram), np.diag(self.gram)).clip(1e-12)
        n, side = len(self.detail), 2 * self.reach + 1
        whole = np.stack([self._whole(j) for j in range(n)]).reshape(n, -1)

        def like(rest: Sequence[int], u: Float[np.ndarray, " q"]) -> Float[np.ndarray, "m places"]:
            return np.stack([self._like(k, u.reshape(self.core.shape[1:])).ravel() for k in rest])

        def there(j: int, place: int) -> Float[np.ndarray, " q"]:
            return self.at(j, *divmod(place, side)).ravel()

        at = laid_in_turn(alike, whole, there, like, first=side * self.reach + self.reach)
        return np.stack(np.divmod(at, side), axis=1) - self.reach

    def shifted_back(self, group: Bool[np.ndarray, " n"], y: int, x: int) -> Pictures:
        """As if the pictures of a group had not been shifted by y down and x to the right."""
        detail = self.detail.copy()
        detail[group] = np.roll(detail[group], (-y, -x), axis=(1, 2))
        return replace(self, detail=detail)

    @cached_property
    def _part(self) -> Int[np.ndarray, " q"]:
        """Of the middle's pixels."""
        h, w = self.core.shape[1:]
        return ((np.arange(h) * SIDE // h)[:, None] * SIDE + np.arange(w) * SIDE // w).ravel()

    def rest(self, j: int, U: Float[np.ndarray, "k q"], y: int, x: int) -> Float[np.ndarray, " parts"]:
        """What U leaves of picture j in each part of the middle, where it is laid at row y and column x."""
        A = self.at(j, y, x).ravel()
        return np.bincount(self._part, (A - (U @ A) @ U) ** 2) + 1e-9

    def agreed(self, among: Bool[np.ndarray, " n"], j: int, y: int, x: int) -> bool:
        """Whether picture j fits better in all its parts, as a rule, where the shift at row y and column x is taken."""
        U = self.principal(among, j)
        change = np.log(self.rest(j, U, y, x) / self.rest(j, U, self.reach, self.reach))
        return clearly_less(change)


def laid_in_turn(
    alike: Float[np.ndarray, "n n"],
    whole: Float[np.ndarray, "n places"],
    there: Callable[[int, int], Float[np.ndarray, " q"]],
    like: Callable[[Sequence[int], Float[np.ndarray, " q"]], Float[np.ndarray, "m places"]],
    first: int = 0,
) -> Int[np.ndarray, " n"]:
    """Which of its places each picture is laid at, where those that were laid before explain it best.

    The one that is most `alike` all others lies at its place `first`; the one that fits best is always laid next.

    Parameters
    ----------
    whole : all detail of each picture at each place
    there : a picture at a place
    like : how much of some pictures, at each place, is like a unit vector
    """
    rest, laid = list(range(len(whole))), []
    at, shown = np.full(len(whole), first), np.zeros_like(whole)
    j = int(alike.sum(1).argmax())
    while True:
        rest.remove(j)
        if not rest:
            return at
        u = there(j, int(at[j])).astype(np.float64)
        for v in laid:
            u = u - (u @ v) * v
        if len(laid) < RANK and np.linalg.norm(u) > 1e-6:
            laid.append(u / np.linalg.norm(u))
            shown[rest] += like(rest, laid[-1])
        part = shown[rest] / whole[rest]
        best = int(part.max(1).argmax())
        j = rest[best]
        at[j] = int(part[best].argmax())


def lay_otherwise(shown: Pictures, put_back: Pictures, moved: Pictures, group: Bool[np.ndarray, " n"]) -> float:
    """Logarithm of what the others leave unexplained of a group once it is `put_back`, as part of what they do before.

    Zero where it is not certain that the group lay otherwise. In `moved` the others lie as the group does in `shown`.
    """
    r, those, others = shown.reach, np.flatnonzero(group).tolist(), at_most(np.flatnonzero(~group), MANY).tolist()
    U, whole = shown.principal(~group, those[0]), np.diag(shown.gram)
    before, after = (np.sum([p.rest(j, U, r, r) for j in those], axis=0) for p in (shown, put_back))
    change = np.log(after / before)
    if change.mean() > np.log(TOGETHER) or not clearly_less(change):
        return 0.0
    here = there = 0.0
    for j in others:
        U = shown.principal(~group, j)
        here, there = (part + ((U @ p.core[j].ravel()) ** 2).sum() for part, p in ((here, shown), (there, moved)))
    parts = np.array(
        [before.sum() / whole[group].sum(), after.sum() / whole[group].sum(), 1 - here / whole[others].sum()]
    )
    unlike, still, _ = log_odds(parts) - log_odds(parts[2])
    repeats = there > REPEATS * here
    if parts[0] < LOST or still > STILL * unlike or (repeats and change.mean() > np.log(PLAINLY)):
        return 0.0
    return float(change.mean())


def at_most(pictures: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    """At most so many of some pictures, evenly spaced.

    >>> at_most(np.arange(7), 3).tolist(), at_most(np.arange(3), 3).tolist()
    ([0, 3, 6], [0, 1, 2])
    """
    return pictures[:: -(-len(pictures) // most) or 1]


def log_odds(part: Float[np.ndarray, "*b"]) -> Float[np.ndarray, "*b"]:
    """Of a part of something."""
    return np.log(part.clip(1e-6) / (1 - part).clip(1e-6))


def clearly_less(change: Float[np.ndarray, " parts"]) -> bool:
    """Whether logarithms of a change, one for each part, are below zero as a rule."""
    return bool(-change.mean() > AGREED * (change.std() / SIDE + 1e-3))


def can_tell(pictures: Float[np.ndarray, "n a b"]) -> bool:
    """Whether there are pictures enough, and large enough, to show how they lie."""
    return min(pictures.shape[1:]) >= SIZE and len(pictures) >= LEAST and bool(pictures.any())
