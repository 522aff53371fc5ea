"""Pictures that are shifted against the others, one by one or many alike: a camera or an object that moved.

What a picture should show is told by the others, whatever the lights: pictures of a matt surface are combinations of
three, of others of few more. A picture that moved is such a combination only after it is shifted back. How well it is
one is asked at every shift, so that the combination is not spoilt by where the picture lies.

One picture alone says little: what repeats, as threads of a weave do, fits elsewhere, too, and so do highlights. So it
is judged by how well the pictures of this object fit as a rule. A highlight or the rim of a shadow moves by itself, a
picture as a whole: all of its parts have to fit better.

Where a camera moves once and stays, many pictures are shifted alike, and the others are no measure of them. So pictures
are laid on one of them, the one that fits best first; those that come to lie together elsewhere moved if three pictures
explain all of them clearly better once these are shifted back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.doctor.finding import Finding, listed

SIZE = 32  # pixels of the smaller side, at least
FARTHEST = 12  # pixels of a shift looked for, and at most this part of the smaller side
PART = 5
RANK = 8  # pictures that the others are combined of
LEAST = 6  # pictures
DETAIL = 3.0  # pixels: coarser shading moves with the light
SIDE, AGREED = 6, 2.2  # parts along each side, and standard errors by which they fit better after the shift
UNEXPLAINED = 0.8  # of a picture's detail after the shift, as part of before, below which it may have moved
GROUP, GROUPS, MATT = 3, 3, 3  # pictures shifted alike at least, such groups at most; pictures that tell a matt surface
BESIDE, REPEATED = 3, 0.5  # pixels of a shift that is none, and what is explained elsewhere, as part of that in place
TOGETHER = 0.85  # detail that is left unexplained where a group is shifted back, as part of before
USUAL = 1 / 3  # of what it fits worse by than pictures do as a rule, that is left after the shift
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

    def at(self, j: int, y: int, x: int) -> Float[np.ndarray, "c d"]:
        """What of picture j lies on the middle where it is laid with its row y and column x there."""
        h, w = self.core.shape[1:]
        return self.detail[j, y : y + h, x : x + w]

    def principal(self, among: Bool[np.ndarray, " n"], j: int, rank: int = RANK) -> Float[np.ndarray, "k q"]:
        """Orthonormal pictures that those `among` them but j are combined of, `q` pixels of the middle each."""
        others = np.flatnonzero(among & (np.arange(len(among)) != j))
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

    def apart(self) -> Float[np.ndarray, " parts"]:
        """What three pictures leave of another, as part of its detail, in each part of the middle, summed."""
        r, everything = self.reach, np.ones(len(self.detail), bool)
        left = [self.rest(j, self.principal(everything, j, MATT), r, r) for j in range(len(everything))]
        return (np.stack(left) / np.diag(self.gram).clip(1e-9)[:, None]).sum(0)

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


def clearly_less(change: Float[np.ndarray, " parts"]) -> bool:
    """Whether logarithms of a change, one for each part, are below zero as a rule."""
    return bool(-change.mean() > AGREED * (change.std() / SIDE + 1e-3))


def shifts(pictures: Float[np.ndarray, "n a b"]) -> Float[np.ndarray, "n 2"]:
    """Shift (x right, y down) in pixels of each picture against what the others show; 0 where it is not certain."""
    shown, found = Pictures.of(pictures), np.zeros((len(pictures), 2))
    for _ in range(GROUPS):
        moved = _group(shown)
        if moved is None:
            break
        group, y, x = moved
        shown = shown.shifted_back(group, y, x)
        found[group] += x, y
    return found + _one_by_one(shown)


def _group(shown: Pictures) -> tuple[Bool[np.ndarray, " n"], int, int] | None:
    """Pictures, fewer than half, that are shifted alike by y down and x to the right against the others."""
    at = shown.laid_together()
    places, count = np.unique(at, axis=0, return_counts=True)
    usual = places[count.argmax()]
    before, best = None, None
    for place in places[(count >= GROUP) & (places != usual).any(1)]:
        y, x = (int(v) for v in place - usual)
        there = _near(at, place, usual)
        if before is None:
            before = shown.apart()
        change = np.log(shown.shifted_back(there, y, x).apart() / before)
        if change.mean() < min(np.log(TOGETHER), best[0] if best else 0) and clearly_less(change):
            here = _near(at, usual, place)
            most = 2 * there.sum() > len(at) and here.sum() >= GROUP
            best = change.mean(), (here, -y, -x) if most else (there, y, x)
    return None if best is None or fit_elsewhere(shown.shifted_back(*best[1]), best[1][0]) else best[1]


def fit_elsewhere(shown: Pictures, group: Bool[np.ndarray, " n"]) -> bool:
    """Whether most pictures of a group fit the others after a shift nearly as well as where they are.

    So does what repeats, and what shows nothing but highlights.
    """
    r, found = shown.reach, 0
    for j in np.flatnonzero(group).tolist():
        explained = 1 - shown.left(j, shown.principal(~group, j))
        here = explained[r, r]
        explained[r - BESIDE : r + BESIDE + 1, r - BESIDE : r + BESIDE + 1] = 0
        found += int(explained.max() > REPEATED * here)
    return 2 * found > int(group.sum())


def _near(
    at: Int[np.ndarray, "n 2"], place: Int[np.ndarray, " 2"], other: Int[np.ndarray, " 2"]
) -> Bool[np.ndarray, " n"]:
    """Pictures within a pixel of a place, and nearer to it than to the other."""
    off = np.abs(at - place)
    return (off.max(1) <= 1) & (off.sum(1) < np.abs(at - other).sum(1))


def _one_by_one(shown: Pictures) -> Float[np.ndarray, "n 2"]:
    """Shift (x right, y down) of single pictures."""
    n = len(shown.detail)
    found, everything = np.zeros((n, 2)), np.ones(n, bool)
    suspect = _suspect(shown.unexplained(everything))
    if 2 * suspect.sum() >= n or n - suspect.sum() < LEAST - 1 or not suspect.any():
        return found
    among, left, r = ~suspect, shown.unexplained(~suspect), shown.reach
    suspect, odds = _suspect(left), np.log(left / (1 - left).clip(1e-6))
    worse = odds - np.median(odds[:, r, r])  # than pictures fit as a rule
    spread = 1.4826 * np.median(np.abs(worse[:, r, r]))
    for j in np.flatnonzero(suspect & (worse[:, r, r] > OUTLYING * spread)).tolist():
        y, x = (int(v) for v in np.unravel_index(int(left[j].argmin()), left[j].shape))
        if worse[j, y, x] > USUAL * worse[j, r, r] or not shown.agreed(among, j, y, x):
            continue
        found[j] = x - r + _dip(left[j][y, x - 1 : x + 2]), y - r + _dip(left[j][y - 1 : y + 2, x])
    return found


def _suspect(left: Float[np.ndarray, "n k k"]) -> Bool[np.ndarray, " n"]:
    """Pictures that fit clearly better elsewhere, not at the border of what was tried."""
    r = left.shape[1] // 2
    inside = left[:, 1:-1, 1:-1].min((1, 2))
    return (inside < UNEXPLAINED * left[:, r, r]) & (inside <= left.min((1, 2)))


def tell(pictures: Float[np.ndarray, "n a b"]) -> bool:
    """Whether there are pictures enough, and large enough, to tell how they lie."""
    return min(pictures.shape[1:]) >= SIZE and len(pictures) >= LEAST and bool(pictures.any())


def motion(pictures: Float[np.ndarray, "n a b"], scale: float, names: list[str]) -> list[Finding]:
    """Pictures that moved; `scale` is that of `pictures` against the photographs."""
    if not tell(pictures):
        return []
    shift = shifts(pictures) / scale
    moved = np.flatnonzero(np.abs(shift).max(1) > 0)
    if not moved.size:
        return []
    return [
        Finding(
            "motion",
            True,
            f"{len(moved)} pictures are shifted against the others ({_told(shift, names)}; right and down are "
            "positive); align them, or leave them out and fix camera and object.",
            {"shifts_px": {names[j]: [round(float(v), 2) for v in shift[j]] for j in moved}},
        )
    ]


def _told(shift: Float[np.ndarray, "n 2"], names: list[str]) -> str:
    """Pictures that moved and their shifts, the farthest first; those that moved alike together."""
    places, alike = np.unique(shift, axis=0, return_inverse=True)
    told = []
    for k in np.argsort(-np.linalg.norm(places, axis=1)).tolist():
        x, y = places[k]
        these = np.flatnonzero(alike.ravel() == k)
        if not (x or y):
            continue
        who = names[these[0]]
        if len(these) > 1 and np.ptp(these) == len(these) - 1:
            who += f" to {names[these[-1]]}"
        elif len(these) > 1:
            who = listed([names[j] for j in these])
        told.append(f"{who} by ({x:+.1f}, {y:+.1f}) px")
    return listed(told)


def _dip(values: np.ndarray) -> float:
    """Where the parabola through three values has its ground, from the middle one."""
    before, at, after = (float(v) for v in values)
    return 0.5 * (before - after) / max(before - 2 * at + after, 1e-9)
