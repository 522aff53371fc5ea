"""Mirror spheres looked for in photographs: where lamps are mirrored one by one, and inside which outline.

On a mirror sphere each lamp shows one small reflection that moves from picture to picture: a constellation. Outlines
are looked for around constellations, and in the whole frame; what does not mirror, a coin, a plate, is passed over. Of
the circles around one constellation, the ball's outline, the table's horizon in it, a foot below it, those remain whose
lights explain the shading of the rest of the frame best, and the outermost of them is the sphere's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from photonormal.calibration.circle import Circle, SphereError
from photonormal.calibration.highlight import darkest, is_a_mirror_s, looked_for
from photonormal.calibration.mirror import directions
from photonormal.calibration.outline import outlines, refined, resized
from photonormal.calibration.rim import LINEAR, faded
from photonormal.calibration.shadow import Surroundings
from photonormal.calibration.survey import WORKING_SIZE, Photograph, Survey, root, unexplained
from photonormal.geometry import angle_deg

AROUND = 7.0  # half the side looked at, in radii of the constellation: lamps within 16 degrees of the view fit
PLACE_SIZE = 400  # least side in pixels of the pictures of a place
SEEDS = (1.0, 1.5, 2.2)  # radius of a sphere, in those of its constellation
ALIKE = (0.01, 0.2)  # distance and difference of radii, in radii and pixels, below which circles are one
OUTLINES = 8  # circles tried in each place
CONFIDENCE = 0.3  # below it no sphere was found; objects without one stayed below 0.2
MIRRORS = 0.7  # part of the pictures whose highlight is a mirror's
ENOUGH_PX = 50  # radius of a sphere with which highlights are found surely enough to choose among circles
SPREAD = 0.03  # of the highlights, in radii, below which they do not move
SUPPORTED = 0.15  # unexplained shading below which a circle needs half of CONFIDENCE only
AS_SURE = 0.6  # confidence, as part of the surest circle's around a constellation, that another one needs
AS_WELL = (1.2, 0.02)  # a circle's unexplained shading, relative and absolute, that is as good as another's
TOLD_WELL = (2.0, 0.03)  # the same, for a circle that the user is told of
BEGIN = 0.4  # correlation with what is dark from which a circle is improved by it
TELLS = 0.85  # and from which it tells the sphere's circle from others
ASTRAY = (6.0, 0.35)  # how far below the middle one picture may be, in what that lacks, and at least
AS_DARK = (0.2, 0.002)  # how much less it may be, as part of what the best circle lacks, and absolute
NEAR = (0.0, 0.02, 0.04, 0.06, 0.09)  # a sphere's radius as a part of the lamps' distance
ROUNDS = 3  # of looking for highlights in a circle and improving it by its shadows
UNSURE = 0.12  # what it lacks where a circle that only shadows tell is no surer than chance
FULLY = 0.65  # confidence of such a circle at most
ODD = (0.3, 3.0)  # part of the shading that the lights leave unexplained, and times what any lights would
TOLD_DEG = 5.0  # mean angle between the lights of two circles that is worth telling


@dataclass(frozen=True)
class Found:
    """A circle, how it mirrors, and how it compares.

    Parameters
    ----------
    xy : (n, 2) its highlights, NaN where a picture has none
    mirrored : part of the pictures whose highlight is a mirror's
    rival : confidence of the best circle elsewhere
    notes : what the user is to know
    supported : its lights explain the shading of the rest of the frame
    unexplained : part of that shading which they don't
    shadows : correlation of what is dark around it with the shadows of that sphere under those lights
    astray : pictures whose highlight is not where their shadow says
    """

    circle: Circle
    xy: np.ndarray = field(repr=False)
    mirrored: float
    rival: float = 0.0
    notes: tuple[str, ...] = ()
    supported: bool = False
    unexplained: float = 0.0
    shadows: float = 0.0
    astray: tuple[int, ...] = ()

    def moved(self, x0: float, y0: float, scale: float) -> Found:
        """The same in pixels of the photograph: this place begins at (x0, y0) and was seen `scale` times as large."""
        c = self.circle
        x, y = (c.x + 0.5) / scale - 0.5 + x0, (c.y + 0.5) / scale - 0.5 + y0
        circle = replace(c, x=x, y=y, r=c.r / scale, residual_px=c.residual_px / scale)
        return replace(self, circle=circle, xy=(self.xy + 0.5) / scale - 0.5 + (x0, y0))

    @property
    def good(self) -> bool:
        """Whether it mirrors inside a circle that may be an outline."""
        return self.circle.confidence >= CONFIDENCE / 2 and self.mirrored >= MIRRORS

    @property
    def shades(self) -> bool:
        """Whether what is dark around it is its shadow, as only a sphere of that outline casts it."""
        return self.shadows >= TELLS

    @property
    def merit(self) -> float:
        """Larger, surer, more of a mirror."""
        return float(self.mirrored * self.circle.confidence * np.sqrt(self.circle.r))


def find_spheres(read: Photograph, n: int, where: str, count: int = 1, extra: Sequence[Photograph] = ()) -> list[Found]:
    """The mirror spheres that `n` photographs of one size show, the best first.

    Parameters
    ----------
    extra : pictures under other lights, which only show outlines
    where : what errors call them

    Raises
    ------
    SphereError
        If fewer than `count` were found, or one is cut by the border.
    """
    survey = Survey.of(read, n, extra)
    looked = _looked_at(survey, read, n, extra)
    left, balls = [f for f in looked if f.good], []
    while left:
        first = max(left, key=lambda f: f.merit)
        around = [f for f in left if _overlap(f.circle, first.circle)]
        balls.append(_best(around, survey, where))
        left = [f for f in left if not any(_overlap(f.circle, a.circle) for a in around)]
    balls = [f for f in balls if f.circle.confidence >= CONFIDENCE or f.supported]
    if any(f.shades for f in balls):
        balls = [f for f in balls if f.shades]
    balls.sort(key=lambda f: -f.merit / (f.unexplained + AS_WELL[1]))
    chosen, others = balls[:count], balls[count:]
    if len(chosen) < count:
        raise _refusal(looked, len(chosen), count, where)
    for f in chosen:
        f.circle.check_inside(survey.shape, where)
    if others:
        note = (
            f"another ball that mirrors was seen in {where} at {others[0].circle} and not used; --count {count + 1} "
            "uses both, --circle x,y,r chooses one."
        )
        chosen[0] = replace(chosen[0], notes=(*chosen[0].notes, note))
    return [
        replace(f, rival=max([g.circle.confidence for g in looked if not _overlap(f.circle, g.circle)] + [0.0]))
        for f in chosen
    ]


def _looked_at(survey: Survey, read: Photograph, n: int, extra: Sequence[Photograph]) -> list[Found]:
    """Circles of all places, those alike once."""
    h, w = survey.shape
    places = survey.constellations()
    boxes = [_box(place, (h, w)) for place in places]
    crops = [([], []) for _ in boxes]
    for k in range(n + len(extra)) if boxes else []:
        picture = read(k) if k < n else extra[k - n](0)
        for (rows, columns, scale), (roots, dark) in zip(boxes, crops, strict=True):
            part = picture[rows, columns]
            roots.append(root(part, scale))
            if k < n:
                dark.append(resized(darkest(part), scale))
    found = []
    for (x, y, s), (rows, columns, scale), (roots, dark) in zip(places, boxes, crops, strict=True):
        left, top = columns.start, rows.start
        middle = (x - left + 0.5) * scale - 0.5, (y - top + 0.5) * scale - 0.5
        seeds = [Circle(*middle, part * s * scale, 0.0) for part in SEEDS]
        found += _in_place(roots, np.stack(dark), left, top, scale, seeds)
    found += _in_place(survey.roots, survey.dark / np.float32(255), 0, 0, survey.scale)
    return _apart(found)


def _apart(found: list[Found]) -> list[Found]:
    """Of circles alike the one that explains the shadows best, as sure as the surest of them; the surest first."""
    apart: list[Found] = []
    for f in sorted(found, key=lambda f: (-f.shadows if f.shades else 0.0, -f.circle.confidence)):
        a = f.circle
        for k, b in enumerate(g.circle for g in apart):
            if np.hypot(a.x - b.x, a.y - b.y) + abs(a.r - b.r) <= ALIKE[0] * b.r + ALIKE[1]:
                surest = max(a.confidence, b.confidence)
                apart[k] = replace(apart[k], circle=replace(b, confidence=surest))
                break
        else:
            apart.append(f)
    return sorted(apart, key=lambda f: -f.circle.confidence)


def _box(place: tuple[float, float, float], shape: tuple[int, int]) -> tuple[slice, slice, float]:
    """Rows and columns around a constellation, and the scale that its pictures are looked at in."""
    x, y, s = place
    half = AROUND * s + 4
    rows, columns = (slice(max(0, int(c - half)), min(m, int(c + half) + 1)) for c, m in ((y, shape[0]), (x, shape[1])))
    side = max(rows.stop - rows.start, columns.stop - columns.start)
    return rows, columns, float(np.clip(1.0, PLACE_SIZE / side, WORKING_SIZE / side))


def _in_place(
    roots: list[np.ndarray], dark: np.ndarray, x0: int, y0: int, scale: float, seeds: Sequence[Circle] = ()
) -> list[Found]:
    """The circles of one place, in pixels of the photographs; pictures that begin at (x0, y0).

    The `seeds` are circles, in those of the place, that shadows are looked for from where no edges lead to them.
    """
    pixel = max(1.0, scale)
    around = Surroundings.of(roots[: len(dark)], pixel)
    light, none = around.still**LINEAR, np.full((len(dark), 2), np.nan)

    def seen(c: Circle, near: Sequence[float] = NEAR) -> Found:
        xy, mirrored = _mirrored(c, dark)
        explained, part = max((around.explained(c, xy, part), part) for part in near)
        found = Found(c, xy, mirrored, shadows=explained)
        return replace(found, astray=_astray(around.of_each(c, xy, part))) if found.shades else found

    def of_edges(c: Circle) -> Found:
        return seen(faded(light, c, pixel)) if c.confidence >= CONFIDENCE / 2 else Found(c, none, 0.0)

    found = [of_edges(c) for c in outlines([around.still], OUTLINES, pixel)]
    begin = found
    if not any(f.shades for f in found):
        found += [of_edges(c) for c in outlines(roots, OUTLINES, pixel)]
        begin = [*found, *(seen(c) for c in seeds)]
    best = max(begin, key=lambda f: f.shadows, default=None)
    if best is not None and best.shadows > BEGIN:
        c, near = best.circle, 0.0
        for _ in range(ROUNDS):
            c, near = around.fitted(c, _mirrored(c, dark)[0])
        found += [of_edges(refined(p, np.array([c.x, c.y, c.r]), pixel)) for p in ([around.still], roots)]
        cast = seen(c, (near,))
        sure = float(np.clip(1 - (1 - cast.shadows) / UNSURE, 0, FULLY))
        found.append(replace(cast, circle=replace(c, confidence=sure, residual_px=0.0)))
    return [f.moved(x0, y0, scale) for f in found]


def _astray(each: np.ndarray) -> tuple[int, ...]:
    """Pictures whose shadow is far less explained than the others'."""
    middle = float(np.nanmedian(each)) if np.isfinite(each).any() else 0.0
    return tuple(np.flatnonzero(each < middle - max(ASTRAY[0] * (1 - middle), ASTRAY[1])).tolist())


def _mirrored(circle: Circle, dark: np.ndarray) -> tuple[np.ndarray, float]:
    """Highlights (n, 2) inside a circle, NaN where there are none, and the part of the pictures that mirror."""
    a, b = max(0, int(circle.x - circle.r)), max(0, int(circle.y - circle.r))
    part = dark[:, b : int(circle.y + circle.r) + 2, a : int(circle.x + circle.r) + 2]
    within = Circle(circle.x - a, circle.y - b, circle.r)
    highlights = looked_for(part, within, ENOUGH_PX) if part.size else [None] * len(dark)
    xy = np.array([(h.x + a, h.y + b) if h else (np.nan, np.nan) for h in highlights])
    mirrored = float(np.mean([is_a_mirror_s(h, within) for h in highlights]))
    moves = mirrored > 0 and np.linalg.norm(np.nanstd(xy, axis=0)) >= SPREAD * circle.r
    return xy, mirrored if moves else 0.0


def _overlap(a: Circle, b: Circle) -> bool:
    return np.hypot(a.x - b.x, a.y - b.y) < 0.9 * max(a.r, b.r)


def _best(around: list[Found], survey: Survey, where: str) -> Found:
    """Of circles around one constellation the surest that explains the shadows; where none does, the shading."""
    most = max(f.shadows for f in around)
    if most < TELLS:
        return _best_shaded([f for f in around if f.circle.confidence >= CONFIDENCE] or around, survey, where)
    least = most - AS_DARK[0] * (1 - most) - AS_DARK[1]
    chosen = max((f for f in around if f.shadows >= least), key=lambda f: f.circle.confidence)
    shown = np.isfinite(chosen.xy).all(1)
    left, _ = unexplained(survey.shading([chosen.circle])[shown], directions(chosen.circle, chosen.xy[shown])[0])
    return replace(chosen, supported=True, unexplained=left if np.isfinite(left) else ODD[0])


def _best_shaded(around: list[Found], survey: Survey, where: str) -> Found:
    """The surest circle whose lights explain the frame's shading as well as any.

    Where circles explain it as well but mean other lights, the outermost.
    """
    I = survey.shading([f.circle for f in around])
    both = np.all([np.isfinite(f.xy).all(1) for f in around], axis=0)
    lights = [directions(f.circle, f.xy[both])[0] for f in around]
    fits = np.array([unexplained(I[both], L) for L in lights])  # (rings, 2)
    told = bool(np.isfinite(fits).all() and both.sum() >= 5)
    limit = AS_WELL[0] * fits[:, 0].min() + AS_WELL[1] if told else np.inf
    fitting = [k for k in range(len(around)) if not fits[k, 0] > limit]
    surest = max(around[k].circle.confidence for k in fitting)
    sure = [k for k in fitting if around[k].circle.confidence >= AS_SURE * surest]
    outer = max(sure, key=lambda k: around[k].circle.r)
    alike = [k for k in sure if angle_deg(lights[k], lights[outer]).mean() < TOLD_DEG]
    chosen = max(alike, key=lambda k: around[k].circle.confidence)
    notes, left, least = [], *fits[chosen]
    told_of = TOLD_WELL[0] * fits[:, 0].min() + TOLD_WELL[1] if told else np.inf
    off = [float(angle_deg(L, lights[chosen]).mean()) for L in lights]
    others = [k for k in range(len(around)) if off[k] > TOLD_DEG and not fits[k, 0] > told_of]
    if others:
        other = max(others, key=lambda k: around[k].circle.confidence)
        notes.append(
            f"{where} shows another circle around the highlights, at {around[other].circle}, in which the lights would "
            f"be {off[other]:.0f} degrees elsewhere; look at the picture, and give --circle x,y,r if it is right."
        )
    if told and left > ODD[0] and left > ODD[1] * least:
        notes.append(
            f"the lights of the sphere at {around[chosen].circle} of {where} do not explain how the rest of the frame "
            "is shaded; look at the picture, and give --circle x,y,r where the circle is off."
        )
    supported = told and left < SUPPORTED and left < limit
    unexplained_part = left if told else ODD[0]
    return replace(around[chosen], notes=tuple(notes), supported=supported, unexplained=unexplained_part)


def _refusal(looked: list[Found], found: int, count: int, where: str) -> SphereError:
    best = max(looked, key=lambda f: (f.circle.confidence >= CONFIDENCE, f.mirrored, f.circle.confidence), default=None)
    tried = "no edges"
    if best is not None:
        c = best.circle
        tried = (
            f"the best circle at {c} has a confidence of {c.confidence:.2f}, {CONFIDENCE} is needed"
            if c.confidence < CONFIDENCE
            else f"the circle at {c} mirrors the light in {100 * best.mirrored:.0f} % of the pictures, "
            f"{100 * MIRRORS:.0f} % are needed"
        )
    return SphereError(
        f"{found} of {count} mirror spheres were found in {where} ({tried}); "
        "give --circle x,y,r in pixels from the upper left, or put a mask picture into the folder.",
        () if best is None else (best.circle,),
    )
