"""The reflections of the lights on a mirror sphere, one in each picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from photonormal.calibration.circle import Circle, SphereError
from photonormal.calibration.reflections import Disc, Highlight, Reflections

COLOURED = 0.3  # brightest value of a channel, as part of another's, below which the lamp does not light it
ENOUGH_PX = 200  # radius of a sphere in pixels beyond which pictures are made smaller
PLAIN = 0.1  # peak of full scale that is no shading's
FEW_PX = 12  # area that is no shading's
DIM = 0.015  # peak of full scale below which a reflection is noise
FAINT = 0.15  # peak, as part of the pictures' median, below which a reflection is not the light's
MISSING = 0.25  # part of the pictures that may lack a highlight
ALIKE = 12  # pictures that show how large the lights' reflections are
NOTHING = 1e-6  # what no picture shows
DISTINCT = 1.5  # how much farther a reflection stands out than the next, in most pictures, at a scale that shows it
AS_BRIGHT = 0.7  # how far a broader reflection stands out, as part of what stands out farthest
LARGER = 3.0  # and its light, in that of a finer one
LARGEST = 0.06  # part of the sphere's disc that a light's reflection covers at most


def darkest_channel(picture: Float[np.ndarray, "h w c"]) -> Float[np.ndarray, "h w"]:
    """The darkest of the channels that are lit: a coloured ball's body is dark in one, its highlights in none."""
    bright = picture.max((0, 1))
    return picture[..., bright >= COLOURED * bright.max()].min(-1)


def static_light(pictures: Float[np.ndarray, "n h w"]) -> Float[np.ndarray, "h w"]:
    """What the pictures share: lamps and windows that stay on, the table's reflection. Zero for fewer than four."""
    if len(pictures) < 4:
        return np.zeros_like(pictures[0])
    return np.partition(pictures, (len(pictures) - 1) // 2, axis=0)[(len(pictures) - 1) // 2]


def looked_for(
    pictures: Float[np.ndarray, "n h w"], circle: Circle, enough_px: float = ENOUGH_PX
) -> list[Highlight | None]:
    """The highlight of each picture, None where its light is off, behind the sphere, or not seen alone.

    Pictures of a sphere of more than `enough_px` in radius are made smaller.
    """
    import cv2

    scale = min(1.0, enough_px / circle.r)
    if scale < 1:
        size = tuple(round(scale * m) for m in pictures.shape[:0:-1])
        pictures = np.stack([cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in pictures])
    x, y = (scale * (c + 0.5) - 0.5 for c in (circle.x, circle.y))
    static = static_light(pictures)
    smaller = Circle(x, y, scale * circle.r)
    disc = Disc.of(smaller, static.shape)
    some = pictures[:: max(1, len(pictures) // ALIKE)]
    k = _scale([Reflections.of(p, static, disc) for p in some], smaller)
    found = [h and h.enlarged(1 / scale) for h in (Reflections.of(p, static, disc).highlight(k) for p in pictures)]
    median = float(np.median([h.peak if h else 0.0 for h in found]))
    found = [h if h and h.peak >= FAINT * median else None for h in found]
    small = [h if h and _part(h, circle) <= LARGEST else None for h in found]
    return small if small.count(None) <= MISSING * len(small) else found  # on a matt sphere all are large


def _scale(seen: Sequence[Reflections], circle: Circle) -> int:
    """The scale of the lights' reflections, which are alike: one stands out farther than all else in its picture.

    It is the finest such one, as shading is broad. Where another is as bright and larger, the fine one was that of
    another sphere or of glass.
    """
    heights = np.array([[s.heights(k) for k in s.disc.scales] for s in seen])  # (n, l, 2)
    distinct = np.median((heights[..., 0] + NOTHING) / (heights[..., 1] + NOTHING), axis=0)
    height = np.median(heights[..., 0], axis=0)
    flux = height * 4.0 ** np.arange(len(distinct))
    some = np.flatnonzero(distinct >= DISTINCT)
    if some.size == 0:
        return int(np.median(heights[..., 0] - heights[..., 1], axis=0).argmax())
    found = some[0]
    for k in some[1:]:
        if height[k] > AS_BRIGHT * height[some].max() and flux[k] > LARGER * flux[found]:
            spots = [h for h in (s.highlight(k) for s in seen) if h is not None]
            if np.median([_part(h, circle) / h.peak for h in spots]) < LARGEST:
                found = k
    return int(found)


def is_a_mirror_s(highlight: Highlight | None, circle: Circle) -> bool:
    """Whether there is one small reflection, as a mirror has it: a matt sphere makes broad ones, a rough thing many."""
    return highlight is not None and _stands_out(highlight, circle) and not highlight.rivals


def check_number(found: Sequence[Highlight | None], names: Sequence[str], circle: Circle, where: str) -> None:
    """Raise SphereError where few pictures have a highlight."""
    missing = [name for name, h in zip(names, found, strict=True) if h is None]
    if len(missing) > MISSING * len(found):
        raise SphereError(
            f"no highlight was found on the sphere at {circle} of {where} in {len(missing)} of {len(found)} pictures "
            f"({', '.join(missing[:3])}{', ...' * (len(missing) > 3)}): their lights are off, or behind the sphere, or "
            "the sphere is elsewhere; give --circle x,y,r, or leave those pictures out with --skip.",
            (circle,),
        )


def check_sizes(found: Sequence[Highlight | None], names: Sequence[str], circle: Circle, where: str) -> None:
    """Raise SphereError where highlights are too large for a mirror's."""
    shown = [h for h in found if h is not None]
    small = max(_part(h, circle) for h in shown) <= LARGEST
    if small and np.mean([_stands_out(h, circle) for h in shown]) < 0.5:
        raise SphereError(
            f"the highlights on the sphere at {circle} of {where} are too broad and dim for a mirror's; give --circle "
            "x,y,r where the sphere is elsewhere, or use a mirror sphere.",
            (circle,),
        )
    for highlight, name in zip(found, names, strict=True):
        if highlight is not None and _part(highlight, circle) > LARGEST:
            raise SphereError(
                f"the highlight in {name} of {where} covers {100 * _part(highlight, circle):.0f} % of the sphere at "
                f"{circle} but a small one is needed; give --circle x,y,r where the sphere is elsewhere, use a mirror "
                "sphere and a small or distant light, or expose less.",
                (circle,),
            )


def _stands_out(highlight: Highlight, circle: Circle) -> bool:
    """Whether a reflection is small, and the smaller the dimmer it is: shading is dim and broad."""
    part = _part(highlight, circle)
    plain = highlight.peak >= PLAIN or highlight.area_px <= FEW_PX or part <= LARGEST * highlight.peak
    return plain and highlight.peak >= DIM and part <= LARGEST


def _part(highlight: Highlight, circle: Circle) -> float:
    """Of the sphere's disc that a highlight covers."""
    return highlight.area_px / (np.pi * circle.r**2)
