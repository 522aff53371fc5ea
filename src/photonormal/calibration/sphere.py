"""Photographs that show mirror spheres -> where they are, where lights are reflected, and from which directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from photonormal.calibration import faint
from photonormal.calibration.choice import FoundCircle
from photonormal.calibration.circle import Circle, SphereError, from_mask, magnified, minified
from photonormal.calibration.highlight import check_number, check_sizes, darkest_channel, looked_for
from photonormal.calibration.mirror import directions
from photonormal.calibration.reflections import Highlight
from photonormal.calibration.rim import SMALL
from photonormal.calibration.search import PLACE_SIZE, find_spheres
from photonormal.calibration.shadow import REACH, Surroundings
from photonormal.calibration.survey import Photograph, root

SAME = (0.1, 1.5)  # distance, in radii and in pixels, within which two highlights are one
UNSEEN = Highlight(np.nan, np.nan, 0, 0.0, 0.0, False)  # one that only shadows show
FEW_PX = 15.0  # radius in pixels below which lights of rendered spheres were off by 2 degrees and more now and then
GOOD, FAIR = 0.7, 0.6  # confidence in a circle from which it is called so


@dataclass(frozen=True)
class Projection:
    """What is known of the camera.

    Parameters
    ----------
    focal_px : focal length in pixels; None: orthographic, a camera far away
    centre : where the axis meets the picture, (x, y) in pixels; None: its middle
    """

    focal_px: float | None = None
    centre: tuple[float, float] | None = None

    def axis(self, shape: Sequence[int]) -> tuple[float, float]:
        """Where the axis meets a picture of shape (h, w)."""
        return self.centre or ((shape[1] - 1) / 2, (shape[0] - 1) / 2)


@dataclass(frozen=True)
class Sphere:
    """One mirror sphere under `n` lights.

    Parameters
    ----------
    where : the folder that shows it
    circle : its outline
    rival : confidence of the best circle found elsewhere
    highlights : n reflections, None where a picture has none
    L : (n, 3) unit directions to the lights, NaN without a highlight
    points : (n, 3) where they were reflected, see `mirror.directions`
    shape : (h, w) of the photographs
    notes : what the search wants the user to know
    astray : pictures whose highlight was another thing's, as their shadow shows
    """

    where: str
    circle: Circle
    rival: float
    highlights: tuple[Highlight | None, ...]
    L: np.ndarray
    points: np.ndarray
    shape: tuple[int, int]
    notes: tuple[str, ...] = ()
    astray: tuple[int, ...] = ()

    @property
    def confidence(self) -> str:
        """In words."""
        c = self.circle.confidence
        if c == 1.0:
            return "as it was given: look at the picture"
        return "good" if c >= GOOD else "fair" if c >= FAIR else "poor: look at the picture"

    def of(self, shown: Bool[np.ndarray, " n"]) -> Sphere:
        """The same under some of the lights."""
        highlights = tuple(h for h, there in zip(self.highlights, shown, strict=True) if there)
        return replace(self, highlights=highlights, L=self.L[shown], points=self.points[shown])

    def doubts(self, names: Sequence[str]) -> list[str]:
        """One line for each thing that may be wrong."""
        found = list(self.notes)
        if self.circle.confidence < FAIR:
            found.append(
                f"the sphere in {self.where} was found with a confidence of {self.circle.confidence:.2f} only; look at "
                "the picture, and give --circle x,y,r where the circle is off."
            )
        if self.circle.r < FEW_PX:
            found.append(
                f"the sphere in {self.where} is only {self.circle.r:.0f} pixels in radius, so that half a pixel turns "
                f"a light by {np.degrees(1 / self.circle.r):.0f} degrees; use a larger sphere, or photograph it larger."
            )
        if self.astray:
            found.append(
                f"the shadow of the sphere in {self.where} does not lie where the highlight says in "
                f"{', '.join(names[j] for j in self.astray)}: another thing's was taken, and these lights are left out."
            )
        missing = [names[j] for j, h in enumerate(self.highlights) if h is None and j not in self.astray]
        if missing:
            found.append(
                f"no highlight was found on the sphere in {', '.join(missing)} of {self.where}: the light is off "
                f"there, or behind the sphere; the other {len(names) - len(missing)} lights can be used. If no lamp "
                "was on, the object's picture shows what other light there is: name it with --dark when you measure."
            )
        doubtful = [name for name, h in zip(names, self.highlights, strict=True) if h and h.rivals]
        if doubtful:
            found.append(
                f"the sphere in {self.where} shows several reflections of similar strength in {len(doubtful)} of "
                f"{len(names)} pictures ({', '.join(doubtful[:3])}{', ...' * (len(doubtful) > 3)}), and the strongest "
                "was taken; look at the picture, switch other lamps off, or leave pictures out with --skip."
            )
        if self.circle.cut(self.shape):
            found.append(
                f"{self.circle.cut_off(self.shape, self.where)} and was used by the part that is seen; look at the "
                "picture, and photograph the sphere whole where the circle is off. A given circle's y counts from the "
                "upper edge."
            )
        return found


def look_at_spheres(
    read: Photograph,
    shape: Sequence[int],
    names: Sequence[str],
    where: str,
    circles: Sequence[Circle] = (),
    mask: Bool[np.ndarray, "h w"] | None = None,
    extra: Sequence[Photograph] = (),
    spheres: int = 1,
    camera: Projection | None = None,
) -> list[Sphere]:
    """The mirror spheres of `n` photographs of shape (h, w).

    Their outlines are the `circles` given, or the `mask`'s, or are found in the photographs and the `extra` ones.

    Raises
    ------
    SphereError
        If a sphere is not found or largely cut off by the border, or several photographs show no highlight on it.
    """
    camera = camera or Projection()
    if circles:
        for c in circles:
            if not (c.r > 2 and -c.r < c.x < shape[1] + c.r and -c.r < c.y < shape[0] + c.r):
                raise SphereError(
                    f"--circle {c.x:g},{c.y:g},{c.r:g} lies outside {where}, {shape[1]} x {shape[0]} pixels; give x "
                    "and y of its centre from the upper left, and its radius, in pixels."
                )
    elif mask is not None and spheres == 1:
        circles = [from_mask(mask, where)]
    found = [FoundCircle(c, np.empty((0, 2)), 1.0, 0.0) for c in circles]
    found = found or find_spheres(read, len(names), where, spheres, extra)
    return [_one(read, shape, names, where, f, camera) for f in found]


def _one(
    read: Photograph, shape: Sequence[int], names: Sequence[str], where: str, found: FoundCircle, camera: Projection
) -> Sphere:
    circle = found.circle
    half = REACH[1] * circle.r + 2
    ball, place, scale = circle.box(circle.r), circle.box(half), max(1.0, PLACE_SIZE / (2 * half))
    by_shadows = found.shades and circle.r < SMALL
    dark, roots = [], []
    for j in range(len(names)):
        picture = read(j)
        dark.append(darkest_channel(picture[ball]))
        if by_shadows:
            roots.append(root(picture[place], scale))
    highlights = looked_for(np.stack(dark), circle.seen_in(ball))
    if not found.shades or circle.r >= faint.LARGEST_PX:  # else shadows will do
        check_number(highlights, names, circle, where)
        check_sizes(highlights, names, circle, where)
    moved = [h and h.moved(ball[1].start, ball[0].start) for h in highlights]
    astray = ()
    if found.shades:
        moved = [h and _as_told(found, j, h) for j, h in enumerate(moved)]
        astray = tuple(j for j, h in enumerate(moved) if h and _elsewhere(found, j, h))
    moved = [None if j in astray else h for j, h in enumerate(moved)]
    xy = np.array([(h.x, h.y) if h else (np.nan, np.nan) for h in moved])
    if by_shadows:
        circle, cast = _cast(roots, place, scale, circle, found.xy, xy)
        xy = faint.moved(xy, cast, circle)
        astray = tuple(j for j in astray if np.isnan(xy[j, 0]))
        moved = [
            replace(h or UNSEEN, x=float(x), y=float(y)) if np.isfinite(x) else None
            for h, (x, y) in zip(moved, xy, strict=True)
        ]
        check_number(moved, names, circle, where)
    L, points = directions(circle, xy, camera.focal_px, camera.axis(shape))
    return Sphere(where, circle, found.rival, tuple(moved), L, points, (shape[0], shape[1]), found.notes, astray)


def _cast(
    roots: list[np.ndarray],
    place: tuple[slice, slice],
    scale: float,
    circle: Circle,
    begin: np.ndarray,
    highlights: np.ndarray,
) -> tuple[Circle, np.ndarray]:
    """A small sphere's outline, on which `highlights` (n, 2) and shadows agree, and where shadows say that lamps are.

    Parameters
    ----------
    roots : square roots of the place's grey levels, so many times enlarged
    begin : where the search took the lamps to be mirrored
    """
    around, corner = Surroundings.of(roots, scale), (place[1].start, place[0].start)

    def seen(xy: np.ndarray) -> np.ndarray:
        return magnified(xy - corner, scale)

    there = faint.agreed(around, circle.seen_in(place).magnified(scale), seen(highlights))
    cast = minified(faint.near(around, there, seen(begin)), scale) + corner
    back = there.minified(scale)
    return replace(back, x=back.x + corner[0], y=back.y + corner[1]), cast


def _as_told(found: FoundCircle, j: int, highlight: Highlight) -> Highlight:
    """Of what stands out in picture j that which explains its shadow; where that is clear, without rivals."""
    x, y = found.xy[j]
    best = min((highlight, *highlight.others), key=lambda h: float(np.nan_to_num(np.hypot(h.x - x, h.y - y))))
    if j in found.told:
        return replace(best, others=())
    return highlight if best is highlight else replace(best, others=(highlight,))


def _elsewhere(found: FoundCircle, j: int, highlight: Highlight) -> bool:
    """Whether the highlight of picture j is not the one that explains its shadow."""
    x, y = found.xy[j]
    return j in found.astray or bool(
        np.hypot(highlight.x - x, highlight.y - y) > max(SAME[0] * found.circle.r, SAME[1])
    )
