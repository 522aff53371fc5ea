"""The reflection of a light on a mirror sphere, found to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibration.circle import Circle, SphereError
from photonormal.types import box_of

COLOURED = 0.3  # brightest value of a channel, as part of another's, below which the lamp does not light it
RIM = 0.8  # part of the radius inside which reflections are looked for; lamps beyond 106 degrees light nothing seen
WIDEST = 0.2  # largest scale, in radii, at which reflections are looked for
ENOUGH_PX = 200  # radius of a sphere in pixels beyond which pictures are made smaller
PLAIN = 0.1  # peak of full scale that is no shading's
FEW_PX = 12  # area that is no shading's
DIM = 0.04  # peak of full scale below which a reflection is noise
SATURATED = 0.98  # of full scale
CORE = 0.9  # part of a saturated peak above which a pixel belongs to a reflection; else half the way up
RIVAL = 0.5  # flux of a second reflection, as part of the first's, above which the choice is doubtful
OPENING = 0.7  # radius of the opening, as part of the largest disc inside a reflection
FAINT = 0.15  # peak, as part of the pictures' median, below which a reflection is not the light's
MISSING = 0.25  # part of the pictures that may lack a highlight
LARGEST = 0.1  # part of the sphere's disc that a light's reflection covers at most


@dataclass(frozen=True)
class Highlight:
    """The reflection of the light in one picture.

    Parameters
    ----------
    x, y : its centroid in pixels
    area_px : pixels that it covers
    peak : how far its brightest smoothed value stands out, in full scale
    flux : what stands out, in full scale times pixels
    saturated : its peak is the largest value that the pictures can hold
    rival : flux of the second largest reflection as part of this one's
    rivals : centroids of the other reflections that are at least RIVAL as strong
    """

    x: float
    y: float
    area_px: int
    peak: float
    flux: float
    saturated: bool
    rival: float = 0.0
    rivals: tuple[tuple[float, float], ...] = ()

    def moved(self, x: float, y: float) -> Highlight:
        """The same, seen in a frame that begins `x` and `y` pixels further to the upper left."""
        rivals = tuple((a + x, b + y) for a, b in self.rivals)
        return replace(self, x=self.x + x, y=self.y + y, rivals=rivals)

    def enlarged(self, factor: float) -> Highlight:
        """The same in a picture that is larger by `factor`."""
        (x, y), *rivals = (
            ((a + 0.5) * factor - 0.5, (b + 0.5) * factor - 0.5) for a, b in ((self.x, self.y), *self.rivals)
        )
        area, flux = round(self.area_px * factor**2), self.flux * factor**2
        return replace(self, x=x, y=y, area_px=area, flux=flux, rivals=tuple(rivals))


def darkest(picture: Float[np.ndarray, "h w c"]) -> Float[np.ndarray, "h w"]:
    """The darkest of the channels that are lit: a coloured ball's body is dark in one, its highlights in none."""
    bright = picture.max((0, 1))
    return picture[..., bright >= COLOURED * bright.max()].min(-1)


def static_light(pictures: Float[np.ndarray, "n h w"]) -> Float[np.ndarray, "h w"]:
    """What the pictures share: lamps and windows that stay on, the table's reflection. Zero for fewer than four."""
    if len(pictures) < 4:
        return np.zeros_like(pictures[0])
    return np.partition(pictures, (len(pictures) - 1) // 2, axis=0)[(len(pictures) - 1) // 2]


def find_highlight(
    picture: Float[np.ndarray, "h w"], static: Float[np.ndarray, "h w"], circle: Circle
) -> Highlight | None:
    """The strongest small reflection inside the circle after what is `static` has been taken away; None in the dark.

    What stands out of its surroundings forms reflections, so that a bright table that the sphere shows is none. Among
    them the one of most flux is the light: a second reflection, by another sphere or by glass, is weaker. Its pixels
    are those above a part of its peak. Streaks that scratches and the lens draw are cut off by morphological opening.
    The centroid is weighted by what exceeds the threshold, so that a saturated core counts evenly and its rim, a
    fraction of a pixel, by how much of it is covered.
    """
    inside = circle.inside(picture.shape, RIM)
    level = np.where(inside, np.maximum(picture - static, 0), 0).astype(np.float32)
    scales = [2.0**k for k in range(int(np.log2(max(2.0, WIDEST * circle.r))) + 3)]
    blurred = [_blurred(level, inside, s) for s in scales]
    proud = [np.where(inside, np.maximum(a * abs(a) - b * abs(b), 0), 0) for a, b in pairwise(blurred[:-1])]
    highest = np.array([p.max() for p in proud])
    if highest.max() <= 0:
        return None
    each = [_spot(p, blurred[0], b, static) for p, b in zip(proud, blurred[2:], strict=True)]
    flux = [
        area * peak if h > RIVAL * highest.max() else 0.0 for h, (_, area, peak, _) in zip(highest, each, strict=True)
    ]
    k = int(np.argmax(flux))  # the scale of the strongest reflection
    count, labels = _parts(proud[k] > RIVAL * proud[k].max())
    flux = np.bincount(labels.ravel(), proud[k].ravel(), minlength=count)[1:]
    order = np.argsort(-flux)
    around = blurred[k + 2]
    found = [
        _spot(np.where(labels == m + 1, proud[k], -1), blurred[0], around, static)
        for m in order
        if flux[m] >= RIVAL * flux[order[0]]
    ]
    (x, y), area, peak, saturated = found[0]
    return Highlight(
        x,
        y,
        area_px=area,
        peak=peak,
        flux=float(flux[order[0]]),
        saturated=saturated,
        rival=float(flux[order[1]] / flux[order[0]]) if len(order) > 1 else 0.0,
        rivals=tuple(place for place, *_ in found[1:]),
    )


def _blurred(level: np.ndarray, inside: np.ndarray, pixels: float) -> np.ndarray:
    """The mean of what is inside around each pixel, weighted by a Gaussian."""
    import cv2

    weight = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), pixels)
    return cv2.GaussianBlur(level, (0, 0), pixels) / weight.clip(1e-3)


def _parts(shown: Bool[np.ndarray, "h w"]) -> tuple[int, np.ndarray]:
    """Connected parts: their number with the ground, and labels (h, w)."""
    import cv2

    return cv2.connectedComponents(shown.astype(np.uint8), connectivity=8)


def _spot(
    proud: np.ndarray, smooth: np.ndarray, around: np.ndarray, static: np.ndarray
) -> tuple[tuple[float, float], int, float, bool]:
    """Centroid, pixels, peak of the reflection that stands out most, and whether it is saturated."""
    top = int(np.where(proud > 0.7 * proud.max(), smooth, -1).argmax())
    peak, ground = float(smooth.flat[top]), float(around.flat[top])
    saturated = peak >= SATURATED * (1 - float(static.flat[top]))
    threshold = max((ground + peak) / 2, CORE * peak if saturated else 0.0)
    _, parts = _parts(smooth > threshold)
    part = parts == parts.flat[top]
    return _centroid(np.maximum(smooth - threshold, 0), part), int(part.sum()), peak - ground, saturated


def looked_for(
    pictures: Float[np.ndarray, "n h w"], circle: Circle, enough_px: float = ENOUGH_PX
) -> list[Highlight | None]:
    """The highlight of each picture, None where its light is off or behind the sphere.

    Pictures of a sphere of more than `enough_px` in radius are made smaller.
    """
    import cv2

    scale = min(1.0, enough_px / circle.r)
    if scale < 1:
        size = tuple(round(scale * m) for m in pictures.shape[:0:-1])
        pictures = np.stack([cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in pictures])
    x, y = (scale * (c + 0.5) - 0.5 for c in (circle.x, circle.y))
    static = static_light(pictures)
    found = [find_highlight(p, static, Circle(x, y, scale * circle.r)) for p in pictures]
    median = float(np.median([h.peak if h else 0.0 for h in found]))
    return [h.enlarged(1 / scale) if h is not None and h.peak >= FAINT * median else None for h in found]


def is_a_mirror_s(highlight: Highlight | None, circle: Circle) -> bool:
    """Whether there is one small reflection, as a mirror has it: a matt sphere makes broad ones, a rough thing many."""
    return highlight is not None and _stands_out(highlight, circle) and highlight.rival < RIVAL


def check_highlights(found: Sequence[Highlight | None], names: Sequence[str], circle: Circle, where: str) -> None:
    """Raise SphereError where few pictures have a highlight, or one that is too large for a mirror."""
    missing = [name for name, h in zip(names, found, strict=True) if h is None]
    if len(missing) > MISSING * len(found):
        raise SphereError(
            f"no highlight was found on the sphere at {circle} of {where} in {len(missing)} of {len(found)} pictures "
            f"({', '.join(missing[:3])}{', ...' * (len(missing) > 3)}): their lights are off, or behind the sphere, or "
            "the sphere is elsewhere; give --circle x,y,r, or leave those pictures out with --skip.",
            (circle,),
        )
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


def _centroid(weights: Float[np.ndarray, "h w"], part: Bool[np.ndarray, "h w"]) -> tuple[float, float]:
    """Weighted centre (x, y) of a reflection without its streaks."""
    import cv2

    box = box_of(part, 1)
    blob = part[box].astype(np.uint8)
    depth = cv2.distanceTransform(np.pad(blob, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]  # pixels to the edge
    radius = OPENING * depth.max()
    opened = (cv2.distanceTransform((depth < radius).astype(np.uint8), cv2.DIST_L2, 5) < radius) & (blob > 0)
    row, column = np.nonzero(opened)
    w = weights[box][row, column]
    return float((column * w).sum() / w.sum() + box[1].start), float((row * w).sum() / w.sum() + box[0].start)
