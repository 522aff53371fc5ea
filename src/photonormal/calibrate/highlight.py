"""The reflection of a light on a mirror sphere, found to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibrate.circle import Circle
from photonormal.types import InputError

RIM = 0.985  # part of the radius inside which reflections are looked for; the rest is the outline itself
SATURATED = 0.98  # of full scale
CORE = {True: 0.9, False: 0.5}  # saturated or not: part of the peak above which a pixel belongs to a reflection
RIVAL = 0.5  # flux of a second reflection, as part of the first's, above which the choice is doubtful
OPENING = 0.7  # radius of the opening, as part of the largest disc inside a reflection
FAINT = 0.15  # peak, as part of the pictures' median, below which a reflection is not the light's
LARGEST = 0.1  # part of the sphere's disc that a light's reflection covers at most


@dataclass(frozen=True)
class Highlight:
    """The reflection of the light in one picture.

    Parameters
    ----------
    x, y : its centroid in pixels
    area_px : pixels that it covers
    peak : the brightest smoothed value, in full scale
    flux : what it adds to the picture, in full scale times pixels
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


def static_light(pictures: Float[np.ndarray, "n h w"]) -> Float[np.ndarray, "h w"]:
    """What all pictures share: lamps and windows that stay on. Zero for fewer than four pictures."""
    return pictures.min(0) if len(pictures) >= 4 else np.zeros_like(pictures[0])


def find_highlight(
    picture: Float[np.ndarray, "h w"], static: Float[np.ndarray, "h w"], circle: Circle
) -> Highlight | None:
    """The strongest reflection inside the circle after what is `static` has been taken away; None in the dark.

    Pixels above a part of the peak form reflections. Among them the one of most flux is the light: a second
    reflection, by another sphere or by glass, is weaker. Streaks that scratches and the lens draw are cut off by
    morphological opening. The centroid is weighted by what exceeds the threshold, so that a saturated core counts
    evenly and its rim, a fraction of a pixel, by how much of it is covered.
    """
    import cv2

    level = np.where(circle.inside(picture.shape, RIM), np.maximum(picture - static, 0), 0).astype(np.float32)
    smooth = cv2.GaussianBlur(level, (0, 0), 1.0)
    peak = float(smooth.max())
    if peak <= 0:
        return None
    saturated = peak >= SATURATED * (1 - float(static.flat[int(smooth.argmax())]))
    threshold = CORE[saturated] * peak
    count, labels, stats, _ = cv2.connectedComponentsWithStats((smooth > threshold).astype(np.uint8), connectivity=8)
    excess = np.maximum(smooth - threshold, 0)
    flux = np.bincount(labels.ravel(), level.ravel(), minlength=count)[1:]
    order = np.argsort(-flux)
    first = order[0]
    centroids = {k: _centroid(excess, labels == k + 1) for k in order if flux[k] >= RIVAL * flux[first]}
    return Highlight(
        *centroids[first],
        area_px=int(stats[first + 1, cv2.CC_STAT_AREA]),
        peak=peak,
        flux=float(flux[first]),
        saturated=saturated,
        rival=float(flux[order[1]] / flux[first]) if len(order) > 1 else 0.0,
        rivals=tuple(centroids[k] for k in order[1:] if k in centroids),
    )


def check_highlights(found: list[Highlight | None], names: list[str], circle: Circle, where: str) -> list[Highlight]:
    """The highlights, or InputError: a light behind the sphere leaves none, a matt sphere makes broad ones."""
    median = float(np.median([h.peak if h else 0.0 for h in found]))
    for highlight, name in zip(found, names, strict=True):
        if highlight is None or highlight.peak < FAINT * median:
            raise InputError(
                f"no highlight was found on the sphere in {name} of {where}: its light is off, or behind the sphere; "
                "leave that picture out of both folders, or photograph it again."
            )
        if highlight.area_px > LARGEST * np.pi * circle.r**2:
            part = 100 * highlight.area_px / (np.pi * circle.r**2)
            raise InputError(
                f"the highlight in {name} of {where} covers {part:.0f} % of the sphere but a small one is needed; "
                "use a mirror sphere and a small or distant light, or expose less."
            )
    return [h for h in found if h is not None]


def _centroid(weights: Float[np.ndarray, "h w"], part: Bool[np.ndarray, "h w"]) -> tuple[float, float]:
    """Weighted centre (x, y) of a reflection without its streaks."""
    import cv2

    rows, columns = (np.flatnonzero(part.any(axis)) for axis in (1, 0))
    box = np.s_[max(0, rows[0] - 1) : rows[-1] + 2, max(0, columns[0] - 1) : columns[-1] + 2]
    blob = part[box].astype(np.uint8)
    depth = cv2.distanceTransform(np.pad(blob, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]  # pixels to the edge
    radius = OPENING * depth.max()
    opened = (cv2.distanceTransform((depth < radius).astype(np.uint8), cv2.DIST_L2, 5) < radius) & (blob > 0)
    row, column = np.nonzero(opened)
    w = weights[box][row, column]
    return float((column * w).sum() / w.sum() + box[1].start), float((row * w).sum() / w.sum() + box[0].start)
