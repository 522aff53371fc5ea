"""Mirror spheres looked for in photographs: where lamps are mirrored one by one, and inside which outline.

On a mirror sphere each lamp shows one small reflection that moves from picture to picture: a constellation. Outlines
are looked for around constellations, and in the whole frame; what does not mirror, a coin, a plate, is passed over. Of
the circles around one constellation, the ball's outline, the table's horizon in it, a foot below it, those remain whose
lights explain the shading of the rest of the frame best, and the outermost of them is the sphere's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from photonormal.calibration import faint
from photonormal.calibration.choice import AS_WELL, CONFIDENCE, MIRRORS, FoundCircle, apart, best_of, overlap
from photonormal.calibration.circle import Circle, SphereError, magnified
from photonormal.calibration.highlight import darkest_channel, is_a_mirror_s, looked_for
from photonormal.calibration.outline import outlines, refined_circle, resized
from photonormal.calibration.reflections import TOPS
from photonormal.calibration.rim import LINEAR, faded
from photonormal.calibration.shadow import Surroundings
from photonormal.calibration.survey import WORKING_SIZE, Photograph, Survey, root

AROUND = 7.0  # half the side looked at, in radii of the constellation: lamps within 16 degrees of the view fit
PLACE_SIZE = 400  # least side in pixels of the pictures of a place
SEEDS = (1.0, 1.5, 2.2)  # radius of a sphere, in those of its constellation
OUTLINES = 8  # circles tried in each place
ENOUGH_PX = 50  # radius of a sphere with which highlights are found surely enough to choose among circles
SPREAD = 0.03  # of the highlights, in radii, below which they do not move
BEGIN = 0.4  # correlation with what is dark from which a circle is improved by it
ASTRAY = (6.0, 0.35)  # how far below the middle one picture may be, in what that lacks, and at least
FAINTLY = (
    "the sphere mirrors the lamps hardly more brightly than noise, so its shadows were used to find them; use a "
    "larger or shinier sphere, or expose longer."
)
ROUNDS = 3  # of looking for highlights in a circle and improving it by its shadows
UNSURE = 0.12  # what it lacks where a circle that only shadows show is no surer than chance
FULLY = 0.65  # confidence of such a circle at most


def find_spheres(
    read: Photograph, n: int, where: str, count: int = 1, extra: Sequence[Photograph] = ()
) -> list[FoundCircle]:
    """The mirror spheres that `n` photographs of one size show, the best first.

    Parameters
    ----------
    extra : pictures under other lights, which only show outlines
    where : what errors call them

    Raises
    ------
    SphereError
        If fewer than `count` were found, or one is largely cut off by the border.
    """
    survey = Survey.of(read, n, extra)
    looked = _looked_at(survey.constellations(), survey, read, n, extra)
    looked += _in_place(survey.roots, survey.dark / np.float32(255), 0, 0, survey.scale)
    balls = _balls(looked, survey, where)
    if len(balls) < count:
        looked += _looked_at(_shaded(survey), survey, read, n, extra)
        balls = _balls(looked, survey, where)
    chosen, others = balls[:count], balls[count:]
    if len(chosen) < count:
        raise _refusal(looked, len(chosen), count, where, survey.shape)
    for f in chosen:
        f.circle.check_inside(survey.shape, where)
    if others:
        note = (
            f"another ball that mirrors was seen in {where} at {others[0].circle} and not used; --count {count + 1} "
            "uses both, --circle x,y,r chooses one."
        )
        chosen[0] = replace(chosen[0], notes=(*chosen[0].notes, note))
    return [
        replace(f, rival=max([g.circle.confidence for g in looked if not overlap(f.circle, g.circle)] + [0.0]))
        for f in chosen
    ]


def _balls(looked: list[FoundCircle], survey: Survey, where: str) -> list[FoundCircle]:
    """Of circles that were looked at those of mirror spheres, the best first."""
    left, balls = [f for f in apart(looked) if f.good], []
    while left:
        first = max(left, key=lambda f: f.merit)
        around = [f for f in left if overlap(f.circle, first.circle)]
        balls.append(best_of(around, survey, where))
        left = [f for f in left if not any(overlap(f.circle, a.circle) for a in around)]
    balls = [f for f in balls if f.circle.confidence >= CONFIDENCE or f.supported]
    if any(f.shades for f in balls):
        balls = [f for f in balls if f.shades]
    return sorted(balls, key=lambda f: -f.merit / (f.unexplained + AS_WELL[1]) / f.width)  # the finer, the better


def _shaded(survey: Survey) -> list[tuple[float, float, float]]:
    """Places (x, y, radius), in pixels of the photographs, of small circles around which shadows turn."""
    around, scale = Surroundings.of(survey.roots[: len(survey.dark)], max(1.0, survey.scale)), survey.scale
    circles = [c.minified(scale) for c in faint.turned_around(around)]
    return [(c.x, c.y, c.r) for c in circles]


def _looked_at(
    places: Sequence[tuple[float, float, float]],
    survey: Survey,
    read: Photograph,
    n: int,
    extra: Sequence[Photograph],
) -> list[FoundCircle]:
    """Circles of places (x, y, radius) in pixels of the photographs."""
    boxes = [_box(place, survey.shape) for place in places]
    crops = [([], []) for _ in boxes]
    for k in range(n + len(extra)) if boxes else []:
        picture = read(k) if k < n else extra[k - n](0)
        for (rows, columns, scale), (roots, dark) in zip(boxes, crops, strict=True):
            part = picture[rows, columns]
            roots.append(root(part, scale))
            if k < n:
                dark.append(resized(darkest_channel(part), scale))
    found = []
    for (x, y, s), (rows, columns, scale), (roots, dark) in zip(places, boxes, crops, strict=True):
        left, top = columns.start, rows.start
        middle = magnified(x - left, scale), magnified(y - top, scale)
        seeds = [Circle(*middle, part * s * scale, 0.0) for part in SEEDS]
        found += _in_place(roots, np.stack(dark), left, top, scale, seeds)
    return found


def _box(place: tuple[float, float, float], shape: tuple[int, int]) -> tuple[slice, slice, float]:
    """Rows and columns around a constellation, and the scale that its pictures are looked at in."""
    x, y, s = place
    half = AROUND * s + 4
    rows, columns = (slice(max(0, int(c - half)), min(m, int(c + half) + 1)) for c, m in ((y, shape[0]), (x, shape[1])))
    side = max(rows.stop - rows.start, columns.stop - columns.start)
    return rows, columns, float(np.clip(1.0, PLACE_SIZE / side, WORKING_SIZE / side))


def _in_place(
    roots: list[np.ndarray], dark: np.ndarray, x0: int, y0: int, scale: float, seeds: Sequence[Circle] = ()
) -> list[FoundCircle]:
    """The circles of one place, in pixels of the photographs; pictures that begin at (x0, y0).

    The `seeds` are circles, in those of the place, that shadows are looked for from where no edges lead to them.
    """
    pixel = max(1.0, scale)
    around = Surroundings.of(roots[: len(dark)], pixel)
    light, none = around.still**LINEAR, np.full((len(dark), 2), np.nan)

    def seen(c: Circle) -> FoundCircle:
        xy, others, mirrored, width = _mirrored(c, dark)
        found = FoundCircle(c, xy, mirrored, width, shadows=around.explained(c, xy))
        if found.shadows > BEGIN and np.isfinite(others).any():
            xy, _ = around.chosen(c, xy, others)
            xy, clear = around.chosen(c, xy, others)  # on the table that these show
            found = replace(found, xy=xy, told=tuple(np.flatnonzero(clear)), shadows=around.explained(c, xy))
        if not found.shades:
            return found
        each = around.of_each(c, xy)
        return replace(found, usually=_middle(each), astray=_astray(each))

    def of_edges(c: Circle) -> FoundCircle:
        return seen(faded(light, c, pixel)) if c.confidence >= CONFIDENCE / 2 else FoundCircle(c, none, 0.0, 1.0)

    found = [of_edges(c) for c in outlines([around.still], OUTLINES, pixel)]
    begin = found
    if not any(f.shades for f in found):
        found += [of_edges(c) for c in outlines(roots, OUTLINES, pixel)]
        begin = [*found, *(seen(c) for c in seeds)]
    best = max(begin, key=lambda f: f.shadows, default=None)
    if best is not None and best.shadows > BEGIN:
        c = best.circle
        for _ in range(ROUNDS):
            c = around.fitted(c, _mirrored(c, dark).xy)
        found += [of_edges(refined_circle(p, np.array([c.x, c.y, c.r]), pixel)) for p in ([around.still], roots)]
        cast = seen(c)
        sure = float(np.clip(1 - (1 - cast.shadows) / UNSURE, 0, FULLY))
        found.append(replace(cast, circle=replace(c, confidence=sure, residual_px=0.0)))
    if not any(f.shades and _shown(f.xy) >= MIRRORS for f in found):
        found = [_faintly(f, around, dark, pixel) for f in found]
    return [f.moved(x0, y0, scale) for f in found]


def _faintly(found: FoundCircle, around: Surroundings, dark: np.ndarray, pixel: float) -> FoundCircle:
    """A small circle with what it mirrors where its shadows say so, if all pictures together mirror there."""
    if found.shadows <= BEGIN or found.circle.r >= faint.LARGEST_PX * pixel:
        return found
    cast = faint.anywhere(around, found.circle, found.xy)
    if _shown(cast) < MIRRORS or not faint.mirrored(dark, cast, pixel):
        return found
    by_all, usually = around.explained(found.circle, cast), _middle(around.of_each(found.circle, cast))
    return replace(found, xy=cast, astray=(), shadows=by_all, usually=usually, notes=(FAINTLY,))


def _shown(xy: np.ndarray) -> float:
    """Part of the pictures with a highlight."""
    return float(np.isfinite(xy).all(1).mean())


def _middle(each: np.ndarray) -> float:
    """Of pictures whose shadow shows something; 0 where none does."""
    return float(np.nanmedian(each)) if np.isfinite(each).any() else 0.0


def _astray(each: np.ndarray) -> tuple[int, ...]:
    """Pictures whose shadow is far less explained than the others'."""
    middle = _middle(each)
    return tuple(np.flatnonzero(each < middle - max(ASTRAY[0] * (1 - middle), ASTRAY[1])).tolist())


class Mirrored(NamedTuple):
    """What is mirrored inside a circle in `n` pictures.

    Parameters
    ----------
    xy : (n, 2) highlights, NaN where there are none
    others : (k, n, 2) what stands out next, likewise
    part : of the pictures, that mirror
    width : radius of the highlights as a rule, in radii of the circle
    """

    xy: np.ndarray
    others: np.ndarray
    part: float
    width: float


def _mirrored(circle: Circle, dark: np.ndarray) -> Mirrored:
    """Highlights inside a circle."""
    box = circle.box(circle.r)
    part, within = dark[:, *box], circle.seen_in(box)
    highlights = looked_for(part, within, ENOUGH_PX) if part.size else [None] * len(dark)
    xy = np.full((TOPS, len(dark), 2), np.nan)
    for j, h in enumerate(highlights):
        for k, spot in enumerate((h, *h.others) if h else ()):
            xy[k, j] = spot.x + box[1].start, spot.y + box[0].start
    mirrored = float(np.mean([is_a_mirror_s(h, within) for h in highlights]))
    areas = [h.area_px for h in highlights if h]
    width = float(np.sqrt(np.median(areas) / np.pi)) / circle.r if areas else 1.0
    moves = mirrored > 0 and np.linalg.norm(np.nanstd(xy[0], axis=0)) >= SPREAD * circle.r
    return Mirrored(xy[0], xy[1:], mirrored if moves else 0.0, width)


def _refusal(looked: list[FoundCircle], found: int, count: int, where: str, shape: tuple[int, int]) -> SphereError:
    best = max(looked, key=lambda f: (f.circle.confidence >= CONFIDENCE, f.mirrored, f.circle.confidence), default=None)
    advice = (
        "where it shows one, give --circle x,y,r in pixels from the upper left; else photograph a mirror sphere under "
        "the same lights, and name its folder with --sphere"
    )
    tried = "no edges"
    if best is not None:
        c = best.circle
        tried = f"the best circle at {c} has a confidence of {c.confidence:.2f}, {CONFIDENCE} is needed"
        if c.confidence >= CONFIDENCE:
            tried = (
                f"the circle at {c} mirrors the light in {100 * best.mirrored:.0f} % of the pictures, "
                f"{100 * MIRRORS:.0f} % are needed"
            )
            if best.mirrored > 0 and c.cut(shape):
                tried, advice = (
                    f"{tried}, and the border cuts it",
                    "photograph the sphere whole, or give --circle x,y,r",
                )
    circles = () if best is None else (best.circle,)
    missing = "no mirror sphere was" if count == 1 else f"{found} of {count} mirror spheres were"
    return SphereError(f"{missing} found in {where} ({tried}); {advice}.", circles)
