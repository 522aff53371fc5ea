"""Circles that may be a sphere's outline, and which of those around the same highlights is.

It is the one whose shadows are where the photographs are dark. Where no shadows are seen: of those whose lights explain
the shading of the rest of the frame best the outermost.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from photonormal.calibration.circle import Circle, minified
from photonormal.calibration.mirror import directions
from photonormal.calibration.survey import Survey, unexplained
from photonormal.geometry import angle_deg

ALIKE = (0.01, 0.2)  # distance and difference of radii, in radii and pixels, below which circles are one
CONFIDENCE = 0.3  # below it no sphere was found; objects without one stayed below 0.2
MIRRORS = 0.7  # part of the pictures whose highlight is a mirror's
SUPPORTED = 0.15  # unexplained shading below which a circle needs half of CONFIDENCE only
AS_SURE = 0.6  # confidence, as part of the surest circle's around a constellation, that another one needs
AS_WELL = (1.2, 0.02)  # a circle's unexplained shading, relative and absolute, that is as good as another's
TOLD_WELL = (2.0, 0.03)  # the same, for a circle that the user hears of
TELLS = 0.85  # and from which it shows which circle is the sphere's
AS_DARK = (0.2, 0.004)  # how much less it may be, as part of what the best circle lacks, and absolute
CLOSE = 0.1  # distance and difference of radii, in radii, of a circle of edges that corrects one of shadows
CORRECTS = (2.0, 0.01)  # what it may lack in explaining shadows, in terms of what the other lacks, and absolute
ODD = (0.3, 3.0)  # part of the shading that the lights leave unexplained, and times what any lights would
TOLD_DEG = 5.0  # mean angle between the lights of two circles that is worth telling


@dataclass(frozen=True)
class FoundCircle:
    """A circle, how it mirrors, and how it compares.

    Parameters
    ----------
    xy : (n, 2) its highlights, NaN where a picture has none
    mirrored : part of the pictures whose highlight is a mirror's
    width : radius of the highlights as a rule, in radii of the circle
    rival : confidence of the best circle elsewhere
    notes : what the user is to know
    supported : its lights explain the shading of the rest of the frame
    unexplained : part of that shading which they don't
    shadows : correlation of what is dark around it with the shadows of that sphere under those lights
    usually : the same in the middle picture, which a few highlights of other things don't change
    astray : pictures whose highlight is not where their shadow says
    told : indices of pictures whose shadow shows which of several reflections is the light's
    """

    circle: Circle
    xy: np.ndarray = field(repr=False)
    mirrored: float
    width: float
    rival: float = 0.0
    notes: tuple[str, ...] = ()
    supported: bool = False
    unexplained: float = 0.0
    shadows: float = 0.0
    usually: float = 0.0
    astray: tuple[int, ...] = ()
    told: tuple[int, ...] = ()

    def moved(self, x0: float, y0: float, scale: float) -> FoundCircle:
        """The same in pixels of the photograph: this place begins at (x0, y0) and was seen `scale` times as large."""
        c = self.circle.minified(scale)
        circle = replace(c, x=c.x + x0, y=c.y + y0, residual_px=c.residual_px / scale)
        return replace(self, circle=circle, xy=minified(self.xy, scale) + np.array([x0, y0]))

    @property
    def mirrors(self) -> float:
        """How surely it is a mirror: highlights that show where its shadows lie are as good as lone ones."""
        return max(self.mirrored, self.shadows if self.shades else 0.0)

    @property
    def good(self) -> bool:
        """Whether it mirrors inside a circle that may be an outline."""
        return self.circle.confidence >= CONFIDENCE / 2 and self.mirrors >= MIRRORS

    @property
    def shades(self) -> bool:
        """Whether what is dark around it is its shadow, as only a sphere of that outline casts it."""
        return self.shadows >= TELLS

    @property
    def merit(self) -> float:
        """Larger, surer, more of a mirror."""
        return float(self.mirrors * self.circle.confidence * np.sqrt(self.circle.r))


def apart(found: list[FoundCircle]) -> list[FoundCircle]:
    """Of circles alike the one that explains the shadows best, as sure as the surest of them; the surest first."""
    kept: list[FoundCircle] = []
    for f in sorted(found, key=lambda f: (-f.shadows if f.shades else 0.0, -f.circle.confidence)):
        a = f.circle
        for k, b in enumerate(g.circle for g in kept):
            if np.hypot(a.x - b.x, a.y - b.y) + abs(a.r - b.r) <= ALIKE[0] * b.r + ALIKE[1]:
                surest = max(a.confidence, b.confidence)
                kept[k] = replace(kept[k], circle=replace(b, confidence=surest))
                break
        else:
            kept.append(f)
    return sorted(kept, key=lambda f: -f.circle.confidence)


def overlap(a: Circle, b: Circle) -> bool:
    return np.hypot(a.x - b.x, a.y - b.y) < 0.9 * max(a.r, b.r)


def best_of(around: list[FoundCircle], survey: Survey, where: str) -> FoundCircle:
    """Of circles around one constellation the surest that explains the shadows; where none does, the shading."""
    if not any(f.shades for f in around):
        return _best_shaded([f for f in around if f.circle.confidence >= CONFIDENCE] or around, survey, where)
    most = max(f.usually for f in around)
    least = most - AS_DARK[0] * (1 - most) - AS_DARK[1]
    chosen = max((f for f in around if f.usually >= least), key=lambda f: f.circle.confidence)
    chosen = corrected(chosen, around)
    shown = np.isfinite(chosen.xy).all(1)
    left, _ = unexplained(survey.shading([chosen.circle])[shown], directions(chosen.circle, chosen.xy[shown])[0])
    return replace(chosen, supported=True, unexplained=left if np.isfinite(left) else ODD[0])


def corrected(cast: FoundCircle, around: list[FoundCircle]) -> FoundCircle:
    """A circle that only shadows show, and the surest one of edges close by: their mean, weighted by confidence."""
    a = cast.circle
    least = 1 - CORRECTS[0] * (1 - cast.shadows) - CORRECTS[1]
    close = [
        f.circle
        for f in around
        if f.shadows >= least and np.hypot(f.circle.x - a.x, f.circle.y - a.y) + abs(f.circle.r - a.r) < CLOSE * a.r
    ]
    b = max((c for c in close if c.residual_px > 0), key=lambda c: c.confidence, default=a)
    if a.residual_px > 0 or b.confidence < CONFIDENCE / 2:
        return cast
    w = b.confidence / max(a.confidence + b.confidence, 1e-9)
    x, y, r = ((1 - w) * m + w * n for m, n in ((a.x, b.x), (a.y, b.y), (a.r, b.r)))
    return replace(cast, circle=replace(b, x=x, y=y, r=r, confidence=max(a.confidence, b.confidence)))


def _best_shaded(around: list[FoundCircle], survey: Survey, where: str) -> FoundCircle:
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
            f"{where} shows another circle around the highlights, at {around[other].circle}, and with it the lights "
            f"would be {off[other]:.0f} degrees elsewhere; look at the picture, and give --circle x,y,r if it is right."
        )
    if told and left > ODD[0] and left > ODD[1] * least:
        notes.append(
            f"the lights of the sphere at {around[chosen].circle} of {where} do not explain how the rest of the frame "
            "is shaded; look at the picture, and give --circle x,y,r where the circle is off."
        )
    supported = told and left < SUPPORTED and left < limit
    unexplained_part = left if told else ODD[0]
    return replace(around[chosen], notes=tuple(notes), supported=supported, unexplained=unexplained_part)
