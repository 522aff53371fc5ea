"""Photographs that show mirror spheres -> where they are, where lights are reflected, and from which directions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibrate.circle import Circle, find_circles, from_mask
from photonormal.calibrate.highlight import Highlight, check_highlights, find_highlight, static_light
from photonormal.calibrate.mirror import directions
from photonormal.types import InputError

Grey = Callable[[int], Float[np.ndarray, "h w"]]  # grey levels in [0, 1] of picture j


@dataclass(frozen=True)
class Camera:
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
    highlights : n reflections
    L : (n, 3) unit directions to the lights
    points : (n, 3) where they were reflected, see `mirror.directions`
    shape : (h, w) of the photographs
    """

    where: str
    circle: Circle
    rival: float
    highlights: tuple[Highlight, ...]
    L: np.ndarray
    points: np.ndarray
    shape: tuple[int, int]

    def doubts(self, names: Sequence[str]) -> list[str]:
        """One line for each thing that may be wrong."""
        found = []
        if self.circle.confidence < 0.5:
            found.append(
                f"the sphere in {self.where} was found with a confidence of {self.circle.confidence:.2f} only; look at "
                "the picture, and give --circle x,y,r where the circle is off."
            )
        doubtful = [name for name, h in zip(names, self.highlights, strict=True) if h.rivals]
        if doubtful:
            found.append(
                f"{len(doubtful)} pictures of {self.where} ({', '.join(doubtful[:3])}{', ...' * (len(doubtful) > 3)}) "
                "have several reflections of similar strength and the strongest was taken; look at the picture, switch "
                "other lamps off, or leave those pictures out."
            )
        try:
            self.circle.check_inside(self.shape, self.where)
        except InputError as error:  # only a circle that was given gets here
            found.append(f"{error} A given circle's y counts from the upper edge.")
        return found


def look_at_spheres(
    grey: Grey,
    shape: Sequence[int],
    names: Sequence[str],
    where: str,
    circles: Sequence[Circle] = (),
    mask: Bool[np.ndarray, "h w"] | None = None,
    extra: Sequence[Grey] = (),
    spheres: int = 1,
    camera: Camera | None = None,
) -> list[Sphere]:
    """The mirror spheres of `n` photographs of shape (h, w).

    Their outlines are the `circles` given, or the `mask`'s, or are found in the photographs and the `extra` ones.

    Raises
    ------
    InputError
        If a sphere is not found or cut by the border, or a photograph shows no highlight on it.
    """
    n, camera, rivals = len(names), camera or Camera(), [0.0] * max(spheres, len(circles))
    if circles:
        for c in circles:
            if not (c.r > 2 and -c.r < c.x < shape[1] + c.r and -c.r < c.y < shape[0] + c.r):
                raise InputError(
                    f"--circle {c.x:g},{c.y:g},{c.r:g} lies outside {where}, {shape[1]} x {shape[0]} pixels; give x "
                    "and y of its centre from the upper left, and its radius, in pixels."
                )
    elif mask is not None and spheres == 1:
        circles = [from_mask(mask, where)]
    else:
        pictures = (read(j) for read, count in ((grey, n), *((e, 1) for e in extra)) for j in range(count))
        found = find_circles(pictures, where, spheres)
        circles, rivals = [c for c, _ in found], [r for _, r in found]
    return [
        _one(grey, shape, names, where, circle, rival, camera) for circle, rival in zip(circles, rivals, strict=True)
    ]


def _one(
    grey: Grey, shape: Sequence[int], names: Sequence[str], where: str, circle: Circle, rival: float, camera: Camera
) -> Sphere:
    x0, y0 = max(0, int(circle.x - circle.r)), max(0, int(circle.y - circle.r))
    box = np.s_[y0 : int(circle.y + circle.r) + 2, x0 : int(circle.x + circle.r) + 2]
    cut = Circle(circle.x - x0, circle.y - y0, circle.r)
    pictures = np.stack([grey(j)[box] for j in range(len(names))])  # (n, h, w) around the sphere
    static = static_light(pictures)
    found = check_highlights([find_highlight(p, static, cut) for p in pictures], list(names), circle, where)
    moved = tuple(h.moved(x0, y0) for h in found)
    xy = np.array([(h.x, h.y) for h in moved])
    L, points = directions(circle, xy, camera.focal_px, camera.axis(shape))
    return Sphere(where, circle, rival, moved, L, points, (shape[0], shape[1]))
