"""Pictures that are shifted against the others, one by one or many alike: a camera or an object that moved.

A picture that moved is a combination of the others only after it is shifted back (`laid`). How well it is one is asked
at every shift, so that the combination is not spoilt by where the picture lies.

One picture alone says little: what repeats, as threads of a weave do, fits elsewhere, too, and so do highlights. So it
is judged by how well the pictures of this object fit as a rule, unless the shift explains most of what was unexplained.
A highlight or the rim of a shadow moves by itself, a picture as a whole: all of its parts have to fit better.

Where a camera moves once and stays, many pictures are shifted alike, and the others are no measure of them. So pictures
are laid on one of them, the one that fits best first; those that come to lie together elsewhere moved if the others
explain them clearly better once they are shifted back. Of what repeats this asks for more: there the others fit one
another after that shift, too.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.doctor.finding import Finding, counted
from photonormal.doctor.laid import LEAST, Pictures, can_tell, lay_otherwise, log_odds
from photonormal.types import a_few

UNEXPLAINED = 0.8  # of a picture's detail after the shift, as part of before, below which it may have moved
GROUP, GROUPS = 3, 3  # pictures shifted alike at least, such groups at most
USUAL = 1 / 3  # of what it fits worse by than pictures do as a rule, that is left after the shift
OUTLYING = 2.0  # robust standard deviations by which it fits worse than the pictures do as a rule, in log odds
PLAIN = 0.4, 1.0  # of its unexplained detail, left after the shift, and those deviations: they suffice


def shifts(pictures: Float[np.ndarray, "n a b"]) -> Float[np.ndarray, "n 2"]:
    """Shift (x right, y down) in pixels of each picture against what the others show; 0 where it is not certain."""
    shown, found = Pictures.of(pictures), np.zeros((len(pictures), 2))
    rest = np.zeros_like(found)
    for _ in range(GROUPS):
        moved = _group(shown)
        if moved is None:
            break
        group, y, x = moved
        rest[group] = _rest(shown, group, y, x)
        shown = shown.shifted_back(group, y, x)
        found[group] += x, y
    alone = _one_by_one(shown)
    return found + np.where(alone.any(1, keepdims=True), alone, rest)


def _rest(shown: Pictures, group: Bool[np.ndarray, " n"], y: int, x: int) -> tuple[float, float]:
    """Parts of a pixel, right and down, by which a group is shifted farther than by y down and x to the right."""
    r, those = shown.reach, np.flatnonzero(group).tolist()
    if max(abs(y), abs(x)) == r:
        return 0.0, 0.0
    U = shown.principal(~group, those[0])
    left = np.mean([np.log(shown.left(j, U)) for j in those], axis=0)
    near = left[y + r - 1 : y + r + 2, x + r - 1 : x + r + 2]
    return (_dip(near[1]), _dip(near[:, 1])) if near.argmin() == 4 else (0.0, 0.0)


def _group(shown: Pictures) -> tuple[Bool[np.ndarray, " n"], int, int] | None:
    """Pictures, fewer than half, that are shifted alike by y down and x to the right against the others."""
    at = shown.laid_together()
    places, count = np.unique(at, axis=0, return_counts=True)
    usual = places[count.argmax()]
    least, best = 0.0, None
    for place in places[(count >= GROUP) & (places != usual).any(1)]:
        y, x = (int(v) for v in place - usual)
        group = _near(at, place, usual)
        if 2 * group.sum() > len(at):
            group, y, x = _near(at, usual, place), -y, -x
        if max(abs(y), abs(x)) > shown.reach:
            continue
        put_back, moved = shown.shifted_back(group, y, x), shown.shifted_back(~group, -y, -x)
        if (change := lay_otherwise(shown, put_back, moved, group)) < least:
            least, best = change, (group, y, x)
    return best


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
    suspect, odds = _suspect(left), log_odds(left)
    worse = odds - np.median(odds[:, r, r])  # than pictures fit as a rule
    spread = 1.4826 * np.median(np.abs(worse[:, r, r]))
    for j in np.flatnonzero(suspect).tolist():
        y, x = (int(v) for v in np.unravel_index(int(left[j].argmin()), left[j].shape))
        unusual = worse[j, r, r] > OUTLYING * spread and worse[j, y, x] <= USUAL * worse[j, r, r]
        plain = worse[j, r, r] > PLAIN[1] * spread and left[j, y, x] < PLAIN[0] * left[j, r, r]
        if not (unusual or plain) or not shown.agreed(among, j, y, x):
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
    if not can_tell(pictures):
        return []
    shift = shifts(pictures) / scale
    moved = np.flatnonzero(np.abs(shift).max(1) > 0)
    if not moved.size:
        return []
    return [
        Finding(
            "motion",
            True,
            f"{counted(len(moved), 'picture is', 'pictures are')} shifted against the others ({_told(shift, names)}; "
            "right and down are positive); align these pictures in an image editor, choose the others with --images, "
            "or photograph again with camera and object fixed.",
            {"shifts_px": {names[j]: [round(float(v), 2) for v in shift[j]] for j in moved}},
        )
    ]


def _told(shift: Float[np.ndarray, "n 2"], names: list[str]) -> str:
    """Pictures that moved and their shifts, the farthest first; those that moved alike together."""
    places, alike = np.unique(shift, axis=0, return_inverse=True)
    texts = []
    for k in np.argsort(-np.linalg.norm(places, axis=1)).tolist():
        x, y = places[k].round(1) + 0.0  # no -0.0
        these = np.flatnonzero(alike.ravel() == k)
        if not (x or y):
            continue
        who = names[these[0]]
        if len(these) > 1 and np.ptp(these) == len(these) - 1:
            who += f" to {names[these[-1]]}"
        elif len(these) > 1:
            who = a_few([names[j] for j in these])
        texts.append(f"{who} by ({x:+.1f}, {y:+.1f}) px")
    return a_few(texts)


def _dip(values: np.ndarray) -> float:
    """Where the parabola through three values has its ground, from the middle one."""
    before, at, after = (float(v) for v in values)
    return 0.5 * (before - after) / max(before - 2 * at + after, 1e-9)
