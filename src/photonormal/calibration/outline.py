"""Circles that the edges of several pictures agree on.

Coordinates in pixels: x to the right, y down, the centre of the upper left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from photonormal.calibration.circle import Circle, fit_circle, minified

VOTING_SIZE = 160  # longest side in pixels of the pictures that vote for circles
VOTERS = 12  # pictures that vote
RADII = (0.05, 0.62)  # smallest and largest radius looked for, fractions of the shorter side
NOISE = 0.01  # gradient, in square roots of full scale a pixel, that counts half: edges on black count, noise does not
EDGE_POWER = 3  # of roots: between linear levels and encoded ones made linear, so that an edge is where it is half way
INNER = 2  # of the surest circles that a fainter one may lie around
OUTER = (1.15, 1.3, 1.45)  # its radius, in theirs: the table's horizon in a ball is 0.71 of its outline
RUNS_OFF = 3.0  # change of a circle, in what is looked at to both sides of it, after which it is another one's
ANGLES = 360  # places around a circle at which its edge is looked for


def outlines(pictures: Sequence[Float[np.ndarray, "h w"]], count: int, pixel: float = 1.0) -> list[Circle]:
    """The `count` circles that most edges point at, fitted to the edges near them; the surest first.

    Edges of all pictures vote along their gradients for centres and radii: an outline stays where it is while
    reflections and shadows move.

    Parameters
    ----------
    pictures : square roots of grey levels (h, w), all of one size
    pixel : width of a photograph's pixel in these pictures; below 1 where they were made smaller
    """
    shape = pictures[0].shape
    size = VOTING_SIZE / max(shape)
    step = max(1, len(pictures) // VOTERS)
    votes = np.sum([_votes(resized(p, size)) for p in pictures[::step]], axis=0)
    found: list[Circle] = []

    def look(x: float, y: float, r: float) -> None:
        circle = refined_circle(pictures, np.array([x, y, r]), pixel)
        if all(np.hypot(circle.x - c.x, circle.y - c.y) + abs(circle.r - c.r) > 0.04 * circle.r for c in found):
            found.append(circle)

    for k, y, x in _peaks(votes, count):
        look(minified(x, size), minified(y, size), _radii(votes.shape[1:])[k] / size)
    found.sort(key=lambda c: -c.confidence)
    for c in found[:INNER]:
        for factor in OUTER:
            look(c.x, c.y, factor * c.r)
    return sorted(found, key=lambda c: -c.confidence)


def resized(picture: np.ndarray, scale: float) -> np.ndarray:
    """A picture made smaller by averaging, or larger smoothly."""
    import cv2

    size = (max(8, round(picture.shape[1] * scale)), max(8, round(picture.shape[0] * scale)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)


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


def refined_circle(pictures: Sequence[np.ndarray], start: np.ndarray, pixel: float = 1.0) -> Circle:
    """The circle nearest to `start` (x, y, r) that fits the pictures' edges, and how much of it they show.

    It is `start`, of which they show nothing, where edges in a line would make it ever larger.
    """
    import cv2

    x, y, r = start
    blur = max(1.0, pixel / 2)  # of edges, where pictures were made larger
    pictures = [picture**EDGE_POWER for picture in pictures]
    phi = 2 * np.pi * np.arange(ANGLES) / ANGLES
    distance, window, place = np.zeros(ANGLES), 0.0, np.zeros((ANGLES, 2))
    for part in (0.08, 0.04, 0.02):
        window = max(part * r, 3.0 * blur)
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
        fitted = fit_circle(place, weights=b.clip(1e-6))[:3]
        if np.abs(np.subtract(fitted, (x, y, r))).max() > RUNS_OFF * window:
            return Circle(*(float(v) for v in start), confidence=0.0, residual_px=float("inf"))
        x, y, r = fitted
    off = np.hypot(place[:, 0] - x, place[:, 1] - y) - r
    tolerance = max(0.004 * r, 0.75 * blur)
    near = np.abs(off) < tolerance
    chance = tolerance / window  # that an edge anywhere in the window is near
    seen = float(near.mean()) - 1.5 / np.sqrt(min(ANGLES, np.pi * r / pixel))  # small circles fit something by luck
    confidence = float(max(0.0, (seen - chance) / (1 - chance)))
    residual = float(np.sqrt((off[near] ** 2).mean())) if near.any() else float("inf")
    return Circle(float(x), float(y), float(r), confidence, residual)
