"""Lamps that a small sphere mirrors in noise, found by its shadows.

A dark ball of ten pixels in radius may mirror a lamp by a few levels, which noise and JPEG move or hide, while its
shadow is as large as itself: where it lies shows the lamp to a degree or two. That the ball mirrors at all the pictures
show together: each is brighter where its own lamp would be mirrored than where the others' would.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from photonormal.calibration.choice import CLOSE, TELLS
from photonormal.calibration.circle import Circle, minified
from photonormal.calibration.mirror import directions
from photonormal.calibration.outline import refined_circle, resized
from photonormal.calibration.reflections import RIM
from photonormal.calibration.shadow import BLUR, FEW, VIEW, ShadowMatch, Surroundings
from photonormal.geometry import normalised

LARGEST_PX = 15  # radius of a sphere below which its shadows alone may show its lamps
PLAINLY = 0.9  # correlation in one picture from which its shadow shows the lamp
TILT_UNSURE = 0.03  # standard deviation of a table's normal as shadows show it
FIRST, LAST = 0.15, 0.01  # steps in radii by which the middle of a shadow is looked for
LOWEST = 0.05  # cosine between lamp and table below which its shadow is too long
WAYS = np.array([(np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 4])
GRID = 0.13  # distance in radii of the places that are tried first where none is known
SHADOWS_TELL = 0.01  # standard deviation in radii of where shadows say that a lamp is mirrored
ASIDE = 3.0  # standard deviations from there, beyond which a highlight is noise or another thing's
NOISE = 0.04  # the same in radii of highlights that are no more than noise
SURELY = 4.0  # standard deviations by which pictures together stand out where their lamps would be mirrored
SIZES = np.geomspace(0.012, 0.06, 5)  # radii of small spheres, as parts of the shorter side
SEEN_AS = 3.0  # pixels of such a radius in pictures made smaller, in which shadows are seen
AGREE = 0.7  # part of the pictures whose shadow lies on one side of a sphere
PLACES, TRIED = 3, 12  # that are given, and that are tried with each radius


def turned_around(around: Surroundings) -> list[Circle]:
    """Small circles of edges, in pixels of the place, around which shadows turn; the best first.

    Beside a sphere each picture is dark on one side and lit on the other, and the sphere stays where it is. A relief is
    dark and lit beside each other everywhere, but shows no round edge there that stays.
    """
    found: list[tuple[float, Circle]] = []
    for r in SIZES * min(around.still.shape):
        for turns, x, y in _turns(around.missing, r):
            for part in (1.0, 1.6):  # a long shadow turns farther outside
                c = refined_circle([around.still], np.array([x, y, part * r]), around.blur / BLUR)
                if np.hypot(c.x - x, c.y - y) < 2 * r:
                    found.append((c.confidence * turns, c))
    chosen: list[Circle] = []
    for value, c in sorted(found, key=lambda f: -f[0]):
        if value > 0 and all(np.hypot(c.x - a.x, c.y - a.y) > c.r + a.r for a in chosen):
            chosen.append(c)
    return chosen[:PLACES]


def _turns(missing: Float[np.ndarray, "n a b"], r: float) -> list[tuple[float, float, float]]:
    """By how much most pictures are darker on one side of a place than on the other, more than around it, and x, y.

    The sides lie about 1.3 of the radius `r` from the place.
    """
    import cv2

    scale, aside = SEEN_AS / r, round(1.33 * SEEN_AS)
    small = [cv2.GaussianBlur(resized(p.astype(np.float32), scale), (0, 0), SEEN_AS / 2) for p in missing]
    wide = np.pad(np.stack(small), ((0, 0), (aside, aside), (aside, aside)), mode="edge")
    inner = slice(aside, -aside)
    across = wide[:, inner, 2 * aside :] - wide[:, inner, : -2 * aside]
    down = wide[:, 2 * aside :, inner] - wide[:, : -2 * aside, inner]
    turns = np.quantile(np.hypot(across, down), 1 - AGREE, axis=0)
    turns -= cv2.GaussianBlur(turns, (0, 0), 10 / 3 * SEEN_AS)
    found = []
    for _ in range(TRIED):
        y, x = np.unravel_index(int(turns.argmax()), turns.shape)
        found.append((float(turns[y, x]), minified(float(x), scale), minified(float(y), scale)))
        turns[max(0, y - 2 * aside + 2) : y + 2 * aside - 1, max(0, x - 2 * aside + 2) : x + 2 * aside - 1] = 0
    return [f for f in found if f[0] > 0]


def agreed(around: Surroundings, circle: Circle, xy: Float[np.ndarray, "n 2"]) -> Circle:
    """Half-way to the circle on which highlights `xy` and shadows mean the same lamps; as it is where these are noise.

    An outline that is off by a pixel turns what highlights say twice to thirty times as far as what shadows say. Both
    circles are off by parts of a pixel, each in its own way, so their mean is nearer than either.
    """
    if around.explained(circle, xy) < TELLS:
        return circle
    fitted = around.fitted(circle, xy)
    change = np.hypot(fitted.x - circle.x, fitted.y - circle.y) + abs(fitted.r - circle.r)
    if change >= CLOSE * circle.r:
        return circle
    x, y, r = ((getattr(circle, k) + getattr(fitted, k)) / 2 for k in "xyr")
    return replace(circle, x=x, y=y, r=r)


def near(around: Surroundings, circle: Circle, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Where the sphere mirrors the lamps whose shadows these are, close to `xy`; NaN where a shadow shows little.

    The table is found by its light and as `xy` explain the shadows best: many pictures show it.
    """
    T = _table(around, circle, xy)
    seen, best = _searched(around.compared(circle, xy, T), circle, xy, T)
    return np.where((best >= PLAINLY)[:, None], seen, np.nan)


def _searched(
    compared: ShadowMatch, circle: Circle, xy: Float[np.ndarray, "n 2"], T: Float[np.ndarray, " 3"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Places close to `xy` that explain each picture's shadow best, and how well."""
    found, best, step = _middles(circle, xy, T), np.nan_to_num(compared.of_each(xy)), FIRST
    while step > LAST:
        tried = np.stack([found + step * way for way in WAYS])  # (ways, n, 2)
        values = np.nan_to_num([compared.of_each(_mirrored_at(circle, t, T)) for t in tried])  # (ways, n)
        way, picture = values.argmax(0), np.arange(len(xy))
        better = values[way, picture] > best
        found = np.where(better[:, None], tried[way, picture], found)
        best = np.maximum(best, values.max(0))
        step = step if better.any() else step / 2
    return _mirrored_at(circle, found, T), best


def _middles(circle: Circle, xy: Float[np.ndarray, "n 2"], T: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "n 2"]:
    """The middles of shadows on the table T, in radii from the sphere's, x right and y up."""
    L, _ = directions(circle, xy)
    return -L[:, :2] / np.maximum(L @ T, LOWEST)[:, None]


def _mirrored_at(
    circle: Circle, middles: Float[np.ndarray, "n 2"], T: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "n 2"]:
    """Where the sphere mirrors the lamps of shadows whose middles lie there on the table T."""
    up = (1 + middles @ T[:2]) / T[2]
    N = normalised(normalised(np.column_stack([-middles, up])) + VIEW)
    return (circle.x, circle.y) + circle.r * N[:, :2] * (1, -1)


def anywhere(around: Surroundings, circle: Circle, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """The same, begun at those of `xy` that explain their shadows, and anywhere in the sphere for the others."""
    told = np.nan_to_num(around.of_each(circle, xy)) >= PLAINLY
    T = around.compared(circle, np.where(told[:, None], xy, np.nan)).table if told.sum() >= FEW else VIEW
    middle = np.full_like(xy, (circle.x, circle.y))
    compared = around.compared(circle, middle, T)
    across = np.arange(-RIM, RIM + GRID / 2, GRID)
    offsets = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    offsets = offsets[np.hypot(*offsets.T) <= RIM]
    values = np.nan_to_num([compared.of_each(middle + circle.r * d) for d in offsets])  # (k, n)
    found = np.where(told[:, None], xy, middle + circle.r * offsets[values.argmax(0)])
    found, _ = _searched(around.compared(circle, found, T), circle, found, T)
    return near(around, circle, found)


def mirrored(dark: Float[np.ndarray, "n a b"], xy: Float[np.ndarray, "n 2"], pixel: float) -> bool:
    """Whether pictures stand out at `xy`, each at its own place, farther than they do at those of others.

    Parameters
    ----------
    dark : their darkest channel
    pixel : width of a photograph's pixel in them
    """
    import cv2

    shown = np.flatnonzero(np.isfinite(xy).all(1))
    m = len(shown)
    if m < FEW:
        return False
    x, y = np.rint(xy[shown]).astype(int).T
    fine, broad = (np.stack([cv2.GaussianBlur(p, (0, 0), s * pixel)[y, x] for p in dark[shown]]) for s in (1, 2))
    proud = fine - broad  # (m, m) of each picture at the place of each
    proud = proud - np.median(proud, axis=0)
    by = np.array([np.mean(proud[np.arange(m), (np.arange(m) + k) % m]) for k in range(m)])
    return bool(by[0] > by[1:].max() and by[0] - by[1:].mean() > SURELY * by[1:].std())


def moved(xy: Float[np.ndarray, "n 2"], cast: Float[np.ndarray, "n 2"], circle: Circle) -> Float[np.ndarray, "n 2"]:
    """Highlights `xy` and where shadows `cast` say that they are: their mean, weighted by how unsure both are.

    How unsure highlights are they tell together, by how far they are from there as a rule. Where they are noise, one
    whose shadow shows nothing is left out.
    """
    off2 = ((xy - cast) ** 2).sum(1)
    both = np.isfinite(off2)
    if both.sum() < FEW:
        return max(cast, xy, key=lambda told: np.isfinite(told).sum())
    sure2 = (SHADOWS_TELL * circle.r) ** 2
    unsure2 = max(0.0, float(np.median(off2[both])) / (2 * np.log(2)) - sure2)
    part = np.where(off2 > ASIDE**2 * (unsure2 + sure2), 1.0, unsure2 / (unsure2 + sure2))
    alone = np.full_like(xy, np.nan) if unsure2 > (NOISE * circle.r) ** 2 else xy
    return np.where(both[:, None], xy + part[:, None] * (cast - xy), np.where(np.isfinite(cast), cast, alone))


def _table(around: Surroundings, circle: Circle, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " 3"]:
    """The table's normal: by its light, and on which lamps mirrored at `xy` explain the shadows best."""
    from scipy.optimize import minimize

    by_light = around.compared(circle, xy)
    T, unsure = by_light.table, by_light.unsure

    def of(p: np.ndarray) -> np.ndarray:
        return normalised(np.array([T[0] + p[0], T[1] + p[1], T[2]]))

    def lacking(p: np.ndarray) -> float:
        return 1 - around.compared(circle, xy, of(p)).correlation

    simplex = np.vstack([np.zeros(2), np.diag([0.1, 0.1])])
    how = {"initial_simplex": simplex, "maxfev": 40, "xatol": 0.003, "fatol": 1e-4}
    by_shadows = minimize(lacking, np.zeros(2), method="Nelder-Mead", options=how).x
    return of(by_shadows * unsure**2 / (unsure**2 + TILT_UNSURE**2))
