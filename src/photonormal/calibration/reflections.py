"""What a sphere mirrors in one picture, at several scales, and where its light is, to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibration.circle import Circle, magnified
from photonormal.masked import box_of

RIM = 0.8  # part of the radius inside which reflections are looked for; lamps beyond 106 degrees light nothing seen
WIDEST = 0.2  # largest scale, in radii, at which reflections are looked for
SATURATED = 0.98  # of full scale
CORE = 0.9  # part of a saturated peak above which a pixel belongs to a reflection; else half the way up
OPENING = 0.7  # radius of the opening, as part of the largest disc inside a reflection
TOPS = 4  # places of a picture that are looked at
APART = 3.0  # distance, in scales, within which two places are one
FEW_PX = 8  # pixels of a part below which its neighbours help to find its middle
POWER = 2.0  # of levels, that makes them light: encoded as most pictures are, hardly worse where they are linear
SMALL_PX = 24  # covered by a reflection that is hardly larger than the blur
HALF_WAY = 1.18  # radius at which a Gaussian is half as high, in standard deviations
REACH, LEAST_PX = 3.0, 12  # how far its surroundings are looked at, in those, and pixels of them
ROUNDS, SETTLED = 8, 0.005  # of least squares, and pixels that are no more than rest
DARK = 0.1  # level below which all are as sure
NARROWEST, MOVES = 0.5, 1.5  # standard deviation in pixels, and how far it moves, in those it began with
FLOOR = 0.05  # of the peak, below which a pixel's logarithm shows nothing
OTHER, RIVAL = 0.2, 0.5  # how far another one stands out, as part of the farthest, to be looked at; and to be doubted


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
    height : how far it stands out at the scale of the lights' reflections
    others : what stands out next in this picture, at least OTHER as far; the farthest first
    """

    x: float
    y: float
    area_px: int
    peak: float
    flux: float
    saturated: bool
    height: float = 0.0
    others: tuple[Highlight, ...] = ()

    @property
    def rivals(self) -> tuple[Highlight, ...]:
        """The others that stand out nearly as far."""
        return tuple(h for h in self.others if h.height >= RIVAL * self.height)

    def moved(self, x: float, y: float) -> Highlight:
        """The same, seen in a frame that begins `x` and `y` pixels further to the upper left."""
        return replace(self, x=self.x + x, y=self.y + y, others=tuple(h.moved(x, y) for h in self.others))

    def enlarged(self, factor: float) -> Highlight:
        """The same in a picture that is larger by `factor`."""
        x, y = magnified(self.x, factor), magnified(self.y, factor)
        area, flux = round(self.area_px * factor**2), self.flux * factor**2
        return replace(self, x=x, y=y, area_px=area, flux=flux, others=tuple(h.enlarged(factor) for h in self.others))


@dataclass(frozen=True)
class Disc:
    """Where reflections are looked for.

    Parameters
    ----------
    inside : (h, w) within RIM of its circle
    whole : (h, w) within the circle: what is near the rim stands out of what lies on both sides
    weights : (k, h, w) the part of each pixel's surroundings in the circle, at ever broader scales
    """

    inside: Bool[np.ndarray, "h w"]
    whole: Bool[np.ndarray, "h w"]
    weights: Float[np.ndarray, "k h w"]

    @classmethod
    def of(cls, circle: Circle, shape: Sequence[int]) -> Disc:
        """Within RIM of a circle, up to scales of WIDEST of it."""
        inside, whole = circle.inside(shape, RIM), circle.inside(shape)
        scales = range(int(np.log2(max(2.0, WIDEST * circle.r))) + 2)
        return cls(inside, whole, np.stack([_blur(whole, k).clip(1e-3) for k in scales]))

    @property
    def scales(self) -> range:
        """What stands out is looked for at these."""
        return range(len(self.weights) - 1)


@dataclass(frozen=True)
class Reflections:
    """What is mirrored inside a disc in one `picture` (h, w), without what is `static`: in levels, and in `light`."""

    picture: Float[np.ndarray, "h w"]
    level: Float[np.ndarray, "h w"]
    light: Float[np.ndarray, "h w"]
    static: Float[np.ndarray, "h w"]
    disc: Disc

    @classmethod
    def of(cls, picture: Float[np.ndarray, "h w"], static: Float[np.ndarray, "h w"], disc: Disc) -> Reflections:
        """Those of a picture."""
        level, light = (
            np.where(disc.whole, np.maximum(picture**p - static**p, 0), 0).astype(np.float32) for p in (1, POWER)
        )
        return cls(picture, level, light, static, disc)

    def blurred(self, k: int) -> Float[np.ndarray, "h w"]:
        """The mean of what is inside around each pixel at scale k, weighted by a Gaussian."""
        return _blur(self.level, k) / self.disc.weights[k]

    def proud(self, k: int) -> Float[np.ndarray, "h w"]:
        """How far each pixel stands out of its surroundings at scale k, as a bright table in the sphere does not."""
        return np.where(self.disc.inside, self.blurred(k) - self.blurred(k + 1), 0)

    def proud_light(self, k: int) -> Float[np.ndarray, "h w"]:
        """The same in light: encoded levels show less of that side of a reflection which lies on brighter ground."""
        return replace(self, level=self.light).proud(k)

    def tops(self, k: int, count: int = TOPS) -> list[tuple[float, int]]:
        """How far places stand out at scale k, and which pixels they are; the highest first."""
        proud, found = self.proud(k), []
        for _ in range(count):
            top = int(proud.argmax())
            height = float(proud.flat[top])
            if height <= 0:
                break
            found.append((height, top))
            y, x = divmod(top, proud.shape[1])
            proud[_within(proud.shape, x, y, APART * 2**k)] = 0
        return found

    def heights(self, k: int) -> tuple[float, float]:
        """How far the first place and the second one stand out at scale k."""
        first, second = ([h for h, _ in self.tops(k, 2)] + [0.0, 0.0])[:2]
        return first, second

    def _in_its_surroundings(self, x: float, y: float, blur: float) -> tuple[float, float]:
        """The middle of a round Gaussian over what lies around it: so many times what is static, and a plane.

        What the sphere mirrors beside a small reflection becomes brighter and darker with the lamp, steeply at the
        table's horizon, and would pull it to one side. Least squares by Gauss and Newton, begun at (x, y).
        """
        row, column = np.nonzero(Circle(x, y, REACH * blur).inside(self.disc.whole.shape) & self.disc.whole)
        if len(row) < LEAST_PX:
            return x, y
        level, static = (a[row, column].astype(np.float64) for a in (self.picture, self.static))
        w = 1 / level.clip(DARK)  # levels are even in their noise, light is their power
        I, around = level**POWER, np.stack([static**POWER, np.ones_like(w), column - x, row - y], axis=-1)  # (m, 4)
        at, s = np.array([x, y]), blur
        for _ in range(ROUNDS):
            d = np.stack([column, row], axis=-1) - at
            r2 = (d**2).sum(1)
            G = np.exp(-r2 / (2 * s**2))
            M = np.column_stack([G, around])
            terms = _least_squares(M, I, w)
            if terms[0] <= 0:
                return x, y
            J = np.column_stack([terms[0] * G[:, None] * d / s**2, terms[0] * G * r2 / s**3, M])
            step = _least_squares(J, I - M @ terms, w)[:3].clip(-s / 2, s / 2)
            at, s = at + step[:2], float(np.clip(s + step[2], NARROWEST, 3 * blur))
            if np.abs(step[:2]).max() < SETTLED:
                break
        return (float(at[0]), float(at[1])) if np.hypot(*(at - (x, y))) < MOVES * blur else (x, y)

    def highlight(self, k: int) -> Highlight | None:
        """What stands out farthest at scale k; None in the dark."""
        tops = self.tops(k)
        if not tops:
            return None
        first, *others = (self._spot(k, *top) for top in tops if top[0] >= OTHER * tops[0][0])
        return replace(first, others=tuple(others))

    def _spot(self, k: int, height: float, top: int) -> Highlight:
        """The reflection there: what exceeds half of the height to which it stands out at scale k.

        Its place is the middle of that; of a saturated one the middle of its core, as glare is no lamp.
        """
        proud, smooth = self.proud(k), self.blurred(0)
        part = _part_at(proud > proud.flat[top] / 2, top)
        area, peak = int(part.sum()), float(smooth.flat[top] - self.blurred(k + 1).flat[top])
        brightest = int(np.where(part, smooth, -1).argmax())
        saturated = float(smooth.flat[brightest]) >= SATURATED * (1 - float(self.static.flat[brightest]))
        if saturated:
            threshold = CORE * smooth.flat[brightest]
            x, y = _centroid(smooth - threshold, _part_at(smooth > threshold, brightest))
        else:
            light = self.proud_light(k)
            x, y = _middle(light if light[part].max() > 0 else proud, part)
            if area <= SMALL_PX and self.static.any():
                x, y = self._in_its_surroundings(x, y, max(1.0, float(np.sqrt(area / np.pi)) / HALF_WAY))
        return Highlight(x, y, area, peak, area * peak, saturated, height)


def _least_squares(
    A: Float[np.ndarray, "m k"], y: Float[np.ndarray, " m"], w: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " k"]:
    """argmin of sum w^2 (A b - y)^2, its columns scaled to be alike, so that one that shows nothing gets no term."""
    A = A * w[:, None]
    size = np.sqrt((A**2).sum(0)).clip(1e-9)
    A = A / size
    return np.linalg.solve(A.T @ A + 1e-6 * np.eye(A.shape[1]), A.T @ (w * y)) / size


def _within(shape: Sequence[int], x: float, y: float, r: float) -> Bool[np.ndarray, "h w"]:
    return Circle(x, y, r).inside(shape)


def _blur(picture: np.ndarray, k: int) -> np.ndarray:
    """Blurred by 2^k pixels."""
    import cv2

    return cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 2.0**k)


def _part_at(shown: Bool[np.ndarray, "h w"], pixel: int) -> Bool[np.ndarray, "h w"]:
    """What is connected with a pixel."""
    import cv2

    _, parts = cv2.connectedComponents(shown.astype(np.uint8), connectivity=8)
    return parts == parts.flat[pixel]


def _middle(proud: Float[np.ndarray, "h w"], part: Bool[np.ndarray, "h w"]) -> tuple[float, float]:
    """The middle (x, y) of a round Gaussian: a parabola fitted to the logarithm, weighted by what stands out."""
    import cv2

    around = cv2.dilate(part.astype(np.uint8), np.ones((3, 3), np.uint8)) if part.sum() < FEW_PX else part
    row, column = np.nonzero(around)
    w = proud[row, column].clip(FLOOR * proud[part].max())
    x, y = float((column * w).sum() / w.sum()), float((row * w).sum() / w.sum())
    dx, dy = column - x, row - y
    A = np.stack([np.ones_like(w), dx, dy, dx**2 + dy**2], axis=-1)  # (m, 4)
    _, a, b, c = np.linalg.lstsq(A * w[:, None], np.log(w) * w, rcond=None)[0]
    if c >= 0 or np.hypot(a, b) > -2 * c:  # no peak within a pixel
        return x, y
    return float(x - a / (2 * c)), float(y - b / (2 * c))


def _centroid(weights: Float[np.ndarray, "h w"], part: Bool[np.ndarray, "h w"]) -> tuple[float, float]:
    """Weighted centre (x, y) of a part without its streaks, which morphological opening cuts off."""
    import cv2

    box = box_of(part, 1)
    blob = part[box].astype(np.uint8)
    depth = cv2.distanceTransform(np.pad(blob, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]  # pixels to the edge
    radius = OPENING * depth.max()
    opened = (cv2.distanceTransform((depth < radius).astype(np.uint8), cv2.DIST_L2, 5) < radius) & (blob > 0)
    row, column = np.nonzero(opened)
    w = weights[box][row, column]
    if not w.any():
        return np.nan, np.nan  # nothing stands out
    return float((column * w).sum() / w.sum() + box[1].start), float((row * w).sum() / w.sum() + box[0].start)
