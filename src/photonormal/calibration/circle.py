"""The outline of a mirror sphere in photographs: from its mask, or around points of its edge.

Coordinates in pixels: x to the right, y down, the centre of the upper left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float

from photonormal.types import InputError

CUT_OFF = 0.5  # part of the radius that the border may cut off: of more rendered balls one was off by 11 degrees


Coordinate = TypeVar("Coordinate", float, np.ndarray)


@dataclass(frozen=True)
class Circle:
    """A sphere's outline.

    Parameters
    ----------
    x, y, r : centre and radius in pixels
    confidence : from 0, no better than chance, to 1, the whole outline was seen; given circles have 1
    residual_px : root of the mean squared distance of the outline's points that support it
    """

    x: float
    y: float
    r: float
    confidence: float = 1.0
    residual_px: float = 0.0

    def __str__(self) -> str:
        return f"{self.x:.1f},{self.y:.1f},{self.r:.1f}"

    def check_inside(self, shape: Sequence[int], where: str) -> None:
        """Raise SphereError where the frame (h, w) cuts off so much of the sphere that its outline is uncertain."""
        if self.beyond(shape) > CUT_OFF * self.r:
            raise SphereError(
                f"{self.cut_off(shape, where)} but at most half of its radius may; photograph it whole.", (self,)
            )

    def cut_off(self, shape: Sequence[int], where: str) -> str:
        """How much of it lies outside the frame (h, w), in words."""
        h, w = shape[:2]
        return (
            f"the sphere in {where} at {self} is cut by the border ({self.beyond(shape):.0f} of its {self.r:.0f} "
            f"pixels of radius lie outside the frame of {w} x {h})"
        )

    def beyond(self, shape: Sequence[int]) -> float:
        """By how many pixels it leaves the frame (h, w)."""
        h, w = shape[:2]
        return self.r - min(self.x, self.y, w - 1 - self.x, h - 1 - self.y)

    def cut(self, shape: Sequence[int]) -> bool:
        """Whether the frame (h, w) cuts it."""
        return self.beyond(shape) > 0.02 * self.r + 1

    def inside(self, shape: Sequence[int], part: float = 1.0) -> Bool[np.ndarray, "h w"]:
        """Pixels within `part` of the radius."""
        y, x = np.ogrid[: shape[0], : shape[1]]
        return (x - self.x) ** 2 + (y - self.y) ** 2 < (part * self.r) ** 2

    def box(self, half: float) -> tuple[slice, slice]:
        """Rows and columns of a frame, `half` pixels to each side of the centre and a little more."""
        rows, columns = (slice(max(0, int(c - half)), int(c + half) + 2) for c in (self.y, self.x))
        return rows, columns

    def seen_in(self, box: tuple[slice, slice]) -> Circle:
        """The same circle in these rows and columns alone."""
        return replace(self, x=self.x - box[1].start, y=self.y - box[0].start)

    def magnified(self, scale: float) -> Circle:
        """The same circle in a picture `scale` times as large."""
        return replace(self, x=magnified(self.x, scale), y=magnified(self.y, scale), r=self.r * scale)

    def minified(self, scale: float) -> Circle:
        """The same circle in a picture `scale` times as small."""
        return replace(self, x=minified(self.x, scale), y=minified(self.y, scale), r=self.r / scale)


def magnified(v: Coordinate, scale: float) -> Coordinate:
    """Coordinates in a picture `scale` times as large."""
    return (v + 0.5) * scale - 0.5


def minified(v: Coordinate, scale: float) -> Coordinate:
    """Coordinates in a picture `scale` times as small."""
    return (v + 0.5) / scale - 0.5


class SphereError(InputError):
    """A refusal, with the circles (x, y, r) that were looked at."""

    def __init__(self, message: str, circles: Sequence[Circle] = ()):
        super().__init__(message)
        self.circles = tuple(circles)


def from_mask(mask: Bool[np.ndarray, "h w"], where: str) -> Circle:
    """The circle around the largest part of a mask, fitted robustly to its outline: stands and dents don't pull it."""
    import cv2

    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        raise InputError(f"the mask of the sphere in {where} is empty; mark the sphere white, or give --circle.")
    points = max(contours, key=cv2.contourArea)[:, 0].astype(np.float64)  # (m, 2), centres of the outermost pixels
    h, w = mask.shape
    free = ((points > 0) & (points < np.array([w - 1, h - 1]))).all(1)
    if free.sum() < 8:
        raise InputError(f"the mask of the sphere in {where} fills the frame; mark only the sphere, or give --circle.")
    x, y, r, weights = fit_circle(points[free])
    distance = np.hypot(*(points[free] - (x, y)).T) - r
    near = np.abs(distance) < max(1.5, 0.02 * r)
    if near.mean() < 0.5:
        raise InputError(f"the mask of the sphere in {where} is no circle; mark the sphere alone, or give --circle.")
    residual = float(np.sqrt(np.average(distance[near] ** 2, weights=weights[near])))
    circle = Circle(x, y, r + 0.5, float(near.mean()), residual)  # the outline runs half a pixel outside the centres
    circle.check_inside(mask.shape, where)
    return circle


def fit_circle(
    points: Float[np.ndarray, "m 2"], weights: Float[np.ndarray, " m"] | None = None, rounds: int = 30
) -> tuple[float, float, float, Float[np.ndarray, " m"]]:
    """Centre, radius and weights (m,) of a robust geometric fit: Gauss-Newton with Geman and McClure's weights."""
    given = np.ones(len(points)) if weights is None else weights
    x, y = np.median(points, axis=0) if weights is None else np.average(points, axis=0, weights=given)
    r = float(np.median(np.hypot(points[:, 0] - x, points[:, 1] - y)))
    w = given
    for _ in range(rounds):
        dx, dy = points[:, 0] - x, points[:, 1] - y
        d = np.hypot(dx, dy).clip(1e-9)
        residual = d - r
        s = max(2.0 * float(np.median(np.abs(residual))), 1e-3)
        w = given / (1 + (residual / s) ** 2) ** 2
        J = np.stack([dx / d, dy / d, np.ones_like(d)], axis=-1)  # (m, 3): d - r falls by J (dx, dy, dr)
        step = np.linalg.lstsq(J * np.sqrt(w)[:, None], residual * np.sqrt(w), rcond=None)[0]
        x, y, r = x + step[0], y + step[1], r + step[2]
        if np.abs(step).max() < 1e-4:
            break
    return float(x), float(y), float(r), w
