"""A picture of what was found: outlines and highlights drawn over the photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8

from photonormal.calibration.circle import Circle, magnified
from photonormal.calibration.sphere import Sphere

HEIGHT = 700  # pixels
LEGIBLE = 60  # radius in pixels of the picture below which a sphere's crosses and numbers would lie on each other
CLOSE = 1.3  # radii around such a sphere that are shown beside it
OUTLINE, CENTRE, RIVALS = (0, 200, 255), (255, 60, 160), (255, 160, 0)  # RGB


def drawn(
    brightest: Float[np.ndarray, "h w"], spheres: Sequence[Sphere], circles: Sequence[Circle] = ()
) -> UInt8[np.ndarray, "a b 3"]:
    """The spheres of one frame, and circles, on the brightest value of each of its pixels; lights count from 1.

    Of a sphere that is small there, its highlights are drawn beside the frame, where it is enlarged.
    """
    legible = LEGIBLE * brightest.shape[0] / HEIGHT
    small, large = [s for s in spheres if s.circle.r < legible], [s for s in spheres if s.circle.r >= legible]
    pictures = [_marked(brightest, large, (*circles, *(s.circle for s in small)))]
    for sphere in small:
        box = sphere.circle.box(CLOSE * sphere.circle.r)
        highlights = tuple(h and h.moved(-box[1].start, -box[0].start) for h in sphere.highlights)
        there = replace(sphere, circle=sphere.circle.seen_in(box), highlights=highlights)
        pictures.append(_marked(brightest[box], [there]))
    return in_one_row(pictures)


def _marked(
    brightest: Float[np.ndarray, "h w"], spheres: Sequence[Sphere], circles: Sequence[Circle] = ()
) -> UInt8[np.ndarray, "a b 3"]:
    """Circles, and spheres with their highlights."""
    import cv2

    scale = HEIGHT / brightest.shape[0]
    size = (max(1, round(brightest.shape[1] * scale)), HEIGHT)
    grey = cv2.resize(brightest.astype(np.float32), size, interpolation=cv2.INTER_AREA if scale < 1 else 1)
    picture = np.repeat(np.rint(255 * grey.clip(0, 1) ** (1 / 2.2)).astype(np.uint8)[..., None], 3, axis=-1)

    def at(x: float, y: float) -> tuple[int, int]:  # in sixteenths of a pixel
        return round(16 * magnified(x, scale)), round(16 * magnified(y, scale))

    for c in (*circles, *(s.circle for s in spheres)):
        cv2.circle(picture, at(c.x, c.y), round(16 * c.r * scale), OUTLINE, 1, cv2.LINE_AA, 4)
        cv2.drawMarker(picture, _whole(at(c.x, c.y)), OUTLINE, cv2.MARKER_CROSS, 12, 1)
    for sphere in spheres:
        for j, h in enumerate(sphere.highlights):
            if h is None:
                continue
            for other in h.rivals:
                cv2.circle(picture, at(other.x, other.y), 16 * 6, RIVALS, 1, cv2.LINE_AA, 4)
            cv2.drawMarker(picture, _whole(at(h.x, h.y)), CENTRE, cv2.MARKER_TILTED_CROSS, 8, 1)
            x, y = _whole(at(h.x, h.y))
            cv2.putText(picture, str(j + 1), (x + 6, y - 4), cv2.FONT_HERSHEY_SIMPLEX, 0.4, CENTRE, 1, cv2.LINE_AA)
    return picture


def in_one_row(pictures: Sequence[UInt8[np.ndarray, "a b 3"]]) -> UInt8[np.ndarray, "a c 3"]:
    """Pictures of one height side by side."""
    gap = np.full((HEIGHT, 6, 3), 255, np.uint8)
    return np.concatenate([part for p in pictures for part in (p, gap)][:-1], axis=1)


def _whole(point: tuple[int, int]) -> tuple[int, int]:
    return round(point[0] / 16), round(point[1] / 16)
