"""The outline of a mirror sphere in photographs: from its mask, or found unaided.

Coordinates in pixels: x to the right, y down, the centre of the upper left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from photonormal.types import InputError

VOTING_SIZE = 160  # longest side in pixels of the pictures that vote for circles
WORKING_SIZE = 800  # and of those that refine the one found
RADII = (0.06, 0.62)  # smallest and largest radius looked for, fractions of the shorter side
CONFIDENCE = 0.3  # below it no sphere was found; objects without one stayed below 0.2
NOISE = 0.01  # gradient, in square roots of full scale a pixel, that counts half: edges on black count, noise does not
ANGLES = 360  # places around a circle at which its edge is looked for


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

    def check_inside(self, shape: Sequence[int], where: str) -> None:
        """Raise InputError where the frame (h, w) cuts the sphere."""
        h, w = shape[:2]
        beyond = self.r - min(self.x, self.y, w - 1 - self.x, h - 1 - self.y)
        if beyond > 0.02 * self.r + 1:
            raise InputError(
                f"the sphere in {where} is cut by the border ({beyond:.0f} of its {self.r:.0f} pixels of radius lie "
                f"outside the frame of {w} x {h}) but its whole outline is needed; photograph it whole."
            )

    def inside(self, shape: Sequence[int], part: float = 1.0) -> Bool[np.ndarray, "h w"]:
        """Pixels within `part` of the radius."""
        y, x = np.ogrid[: shape[0], : shape[1]]
        return (x - self.x) ** 2 + (y - self.y) ** 2 < (part * self.r) ** 2


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


def find_circles(
    pictures: Iterable[Float[np.ndarray, "h w"]], where: str, spheres: int = 1
) -> list[tuple[Circle, float]]:
    """The outlines of mirror spheres, best first; each with the confidence of the best circle elsewhere.

    Edges of all pictures vote along their gradients for centres and radii: an outline stays where it is while
    reflections move. The best circles are fitted again to the edges near them.

    Parameters
    ----------
    pictures : grey levels (h, w) in [0, 1], all of one size, under different lights
    where : what errors call them
    spheres : how many there are

    Raises
    ------
    InputError
        If fewer were found, or one is cut by the border.
    """
    import cv2

    shape, working, votes = (0, 0), [], None
    for picture in pictures:
        shape = picture.shape
        root = np.sqrt(picture.clip(0, 1)).astype(np.float32)
        scale = min(1.0, WORKING_SIZE / max(shape))
        working.append(_resized(cv2.GaussianBlur(root, (0, 0), 1.0), scale))
        cast = _votes(_resized(root, VOTING_SIZE / max(shape)))
        votes = cast if votes is None else votes + cast
    if votes is None:
        raise InputError(f"{where} holds no pictures of a sphere; give a folder with them.")
    found: list[Circle] = []
    for k, y, x in _peaks(votes, 8 * spheres):
        size, ratio = VOTING_SIZE / max(shape), min(1.0, WORKING_SIZE / max(shape))
        corner = np.array([x + 0.5, y + 0.5, _radii(votes.shape[1:])[k]]) / size  # counted from the frame's corner
        circle = _refined(working, corner * ratio - np.array([0.5, 0.5, 0]))
        found.append(
            Circle(
                (circle.x + 0.5) / ratio - 0.5,
                (circle.y + 0.5) / ratio - 0.5,
                circle.r / ratio,
                circle.confidence,
                circle.residual_px / ratio,
            )
        )
    found.sort(key=lambda c: -c.confidence)
    chosen: list[Circle] = []
    for circle in found:
        apart = all(np.hypot(circle.x - c.x, circle.y - c.y) > 0.9 * (circle.r + c.r) for c in chosen)
        if apart and circle.confidence >= CONFIDENCE and len(chosen) < spheres:
            chosen.append(circle)
    if len(chosen) < spheres:
        best = f"the best circle has a confidence of {found[0].confidence:.2f}, {CONFIDENCE} is needed" if found else ""
        raise InputError(
            f"{len(chosen)} of {spheres} mirror spheres were found in {where} ({best or 'no edges'}); "
            "give --circle x,y,r in pixels from the upper left, or put a mask picture into the folder."
        )
    for circle in chosen:
        circle.check_inside(shape, where)
    return [(c, max((o.confidence for o in found if o not in chosen and _differs(o, c)), default=0.0)) for c in chosen]


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


def _differs(a: Circle, b: Circle) -> bool:
    return np.hypot(a.x - b.x, a.y - b.y) + abs(a.r - b.r) > 0.05 * b.r


def _resized(picture: np.ndarray, scale: float) -> np.ndarray:
    import cv2

    size = (max(8, round(picture.shape[1] * scale)), max(8, round(picture.shape[0] * scale)))
    return picture if scale == 1 else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def _radii(shape: Sequence[int]) -> np.ndarray:
    side = min(shape)
    return np.arange(max(4, round(RADII[0] * side)), round(RADII[1] * side))


def _votes(root: np.ndarray) -> np.ndarray:
    """Votes (radii, h, w) of one picture's edges for the centres that their gradients point to."""
    import cv2

    h, w = root.shape
    smooth = cv2.GaussianBlur(root, (0, 0), 1.0)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, dx, 1 - dx, scale=1 / 8) for dx in (1, 0))
    m = np.hypot(gx, gy)
    weight = m / (m + NOISE)  # saturating: a dim outline counts nearly as much as a bright reflection
    row, column = np.nonzero(weight > 0.2)
    weight, ux, uy = (a[row, column] for a in (weight, gx / m.clip(1e-9), gy / m.clip(1e-9)))
    radii = _radii((h, w))
    votes = np.zeros((len(radii), h, w), np.float32)
    for k, r in enumerate(radii):
        for sign in (-1, 1):
            x, y = np.rint(column + sign * r * ux).astype(int), np.rint(row + sign * r * uy).astype(int)
            ok = (x >= 0) & (x < w) & (y >= 0) & (y < h)
            votes[k] += np.bincount((y * w + x)[ok], weight[ok], minlength=h * w).reshape(h, w)
    return votes


def _peaks(votes: np.ndarray, count: int) -> list[tuple[int, int, int]]:
    """Indices (radius, y, x) of the highest places, each at least some pixels from the others."""
    import cv2

    radii = _radii(votes.shape[1:])
    height = np.stack([cv2.GaussianBlur(v, (0, 0), 1.2) / r**0.7 for v, r in zip(votes, radii, strict=True)])
    found = []
    for _ in range(count):
        k, y, x = (int(i) for i in np.unravel_index(height.argmax(), height.shape))
        if height[k, y, x] <= 0:
            break
        found.append((k, y, x))
        height[max(0, k - 3) : k + 4, max(0, y - 4) : y + 5, max(0, x - 4) : x + 5] = 0
    return found


def _refined(pictures: Sequence[np.ndarray], start: np.ndarray) -> Circle:
    """The circle nearest to `start` (x, y, r) that fits the pictures' edges, and how much of it they show."""
    import cv2

    x, y, r = start
    phi = 2 * np.pi * np.arange(ANGLES) / ANGLES
    distance, window, place = np.zeros(ANGLES), 0.0, np.zeros((ANGLES, 2))
    for part in (0.08, 0.04, 0.02):
        window = max(part * r, 3.0)
        t = np.arange(r - window, r + window, 0.5)  # radii sampled
        mx = (x + np.cos(phi)[:, None] * t).astype(np.float32)  # (angles, samples)
        my = (y + np.sin(phi)[:, None] * t).astype(np.float32)
        strength = np.zeros((ANGLES, len(t) - 2))
        for picture in pictures:
            profile = cv2.remap(picture, mx, my, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            slope = np.abs(profile[:, 2:] - profile[:, :-2])
            strength += slope / (slope + NOISE)
        strength = cv2.GaussianBlur(strength, (0, 0), 1.0)
        k = strength[:, 1:-1].argmax(1) + 1
        a, b, c = (strength[np.arange(ANGLES), k + o] for o in (-1, 0, 1))
        vertex = 0.5 * (a - c) / np.minimum(a - 2 * b + c, -1e-9)  # of a parabola through three samples
        distance = t[1:-1][k] + 0.5 * vertex.clip(-1, 1)
        place = np.stack([x + np.cos(phi) * distance, y + np.sin(phi) * distance], axis=-1)
        x, y, r, _ = fit_circle(place, weights=b.clip(1e-6))
    off = np.hypot(place[:, 0] - x, place[:, 1] - y) - r
    tolerance = max(0.004 * r, 0.75)
    near = np.abs(off) < tolerance
    chance = tolerance / window  # that an edge anywhere in the window is near
    seen = float(near.mean()) - 1.5 / np.sqrt(min(ANGLES, np.pi * r))  # small circles fit something by luck
    confidence = float(max(0.0, (seen - chance) / (1 - chance)))
    residual = float(np.sqrt((off[near] ** 2).mean())) if near.any() else float("inf")
    return Circle(float(x), float(y), float(r), confidence, residual)
