"""Small versions of all photographs, to see where lamps are mirrored and how the rest of the frame is shaded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from photonormal.calibration.circle import Circle
from photonormal.calibration.highlight import darkest_channel, static_light
from photonormal.calibration.outline import resized

Photograph = Callable[[int], Float[np.ndarray, "h w c"]]  # levels in [0, 1] of picture j

WORKING_SIZE = 800  # longest side in pixels of the pictures that are searched
SHADING_SIZE = 64  # and of those whose shading is compared
PLACES = 4  # constellations that are looked around
PEAKS, ALL_PEAKS = 100, 3000  # brightest places of a picture, and of all, that may belong to a constellation
BRIGHT = 0.3  # contrast of a peak, as part of its picture's largest
FLOOR = 10  # of 255, that levels count at least where contrast is measured
BROADEST = 31  # pixels across a peak: what is broader is a bright table, and a ball so large is seen without peaks
FINE = 9  # pixels across one that is all fine
TOGETHER = 0.75  # part of the pictures that have a peak in a constellation
GAMMAS = (1.0, 2.2)  # how levels may be encoded


@dataclass(frozen=True)
class Survey:
    """`n` photographs of shape (h, w), made smaller.

    Parameters
    ----------
    roots : square roots of their grey levels, and of those of pictures that only show outlines
    dark : (n, a, b) their darkest channel, of 255: the brightest pixel of those that became one
    """

    shape: tuple[int, int]
    roots: list[np.ndarray]
    dark: UInt8[np.ndarray, "n a b"]

    @classmethod
    def of(cls, read: Photograph, n: int, extra: Sequence[Photograph] = ()) -> Survey:
        """Reads each photograph once."""
        import cv2

        shape, roots, dark = (0, 0), [], []
        for k in range(n + len(extra)):
            picture = read(k) if k < n else extra[k - n](0)
            shape = picture.shape[:2]
            scale = min(1.0, WORKING_SIZE / max(shape))
            roots.append(root(picture, scale))
            if k < n:
                block = np.ones((int(np.ceil(1 / scale)),) * 2, np.uint8)
                level = cv2.dilate(np.rint(255 * darkest_channel(picture).clip(0, 1)).astype(np.uint8), block)
                dark.append(cv2.resize(level, roots[-1].shape[::-1], interpolation=cv2.INTER_NEAREST))
        return cls((shape[0], shape[1]), roots, np.stack(dark))

    @property
    def scale(self) -> float:
        """Width of a photograph's pixel in the small pictures."""
        return self.roots[0].shape[1] / self.shape[1]

    def constellations(self) -> list[tuple[float, float, float]]:
        """Discs (x, y, radius), in pixels of the photographs, that hold a bright peak of nearly each picture.

        The best first: most pictures have a peak there, few have several, and they are fine, as a relief's are not.
        """
        n = len(self.dark)
        of, at, fine = _moving_peaks(self.dark)
        if len(of) == 0:
            return []
        apart = np.hypot(*(at[:, None] - at).transpose(2, 0, 1))  # (m, m)
        pictures = np.eye(n, dtype=np.float32)[of]  # (m, n)
        found = []
        for s in np.geomspace(3.0, 0.4 * min(self.dark.shape[1:]), 14):
            near = (apart < s).astype(np.float32)
            shown, total = (near @ pictures > 0).sum(1), near.sum(1)
            value = shown / n * shown / total * (near @ fine) / total
            found += [(value[k], s, k) for k in np.flatnonzero(shown >= max(3, TOGETHER * n))]
        found.sort(key=lambda f: (-round(float(f[0]), 1), f[1], -f[0]))
        chosen: list[tuple[float, float, float]] = []
        for _, s, k in found:
            x, y = np.median(at[apart[k] < s], axis=0)
            if all(np.hypot(x - a, y - b) > 1.5 * max(s, t) for a, b, t in chosen):
                chosen.append((float(x), float(y), float(s)))
            if len(chosen) == PLACES:
                break
        return [((x + 0.5) / self.scale - 0.5, (y + 0.5) / self.scale - 0.5, s / self.scale) for x, y, s in chosen]

    def shading(self, without: Sequence[Circle]) -> Float[np.ndarray, "n p"]:
        """Grey levels of a coarse version of the photographs, outside the circles."""
        import cv2

        n, (a, b) = len(self.dark), self.roots[0].shape
        scale = min(1.0, SHADING_SIZE / max(a, b))
        size = (max(4, round(b * scale)), max(4, round(a * scale)))
        I = np.stack([cv2.resize(p**2, size, interpolation=cv2.INTER_AREA) for p in self.roots[:n]])
        outside = np.ones(I.shape[1:], bool)
        ratio = size[0] / self.shape[1]
        for c in without:
            outside &= ~Circle((c.x + 0.5) * ratio - 0.5, (c.y + 0.5) * ratio - 0.5, c.r * ratio + 1.5).inside(
                I.shape[1:]
            )
        return I[:, outside]


def root(picture: Float[np.ndarray, "h w c"], scale: float) -> Float[np.ndarray, "a b"]:
    """Square roots of a photograph's grey levels, made smaller by averaging, or larger smoothly."""
    return resized(np.sqrt(picture.mean(-1).clip(0, 1)).astype(np.float32), scale)


def unexplained(I: Float[np.ndarray, "n p"], L: Float[np.ndarray, "n 3"]) -> tuple[float, float]:
    """Part of the shading that a matt surface under lights `L` does not explain, and that no three lights would.

    The middle of all pixels, under the encoding that fits better; NaN where hardly anything is lit.
    """
    lit = I.mean(0) > 0.03
    if lit.sum() < 20:
        return float("nan"), float("nan")
    found = []
    for gamma in GAMMAS:
        J = I[:, lit] ** gamma
        J = J / np.linalg.norm(J, axis=0)
        U = np.linalg.svd(J, full_matrices=False)[0][:, :3]
        Q = np.linalg.qr(L)[0]
        found.append(tuple(float(np.median(np.linalg.norm(J - B @ (B.T @ J), axis=0))) for B in (Q, U)))
    return min(found)


def _moving_peaks(dark: UInt8[np.ndarray, "n a b"]) -> tuple[np.ndarray, Float[np.ndarray, "m 2"], np.ndarray]:
    """The places that stand out most of what moves in each picture: the picture's index (m,), x and y, and how fine
    they are (m,), from 0 to 1.

    What is broad is taken away (a white top-hat), and the rest divided by what is usual there, so that a bright, rough
    table or a relief does not outshine a dark ball.
    """
    import cv2

    rest = np.median(dark, axis=0) if len(dark) >= 4 else static_light(dark)
    of, at, fine = [], [], []
    ground = cv2.GaussianBlur(rest.astype(np.float32), (0, 0), 2.0) + FLOOR
    disc, spot = (cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)) for size in (BROADEST, FINE))
    for j, picture in enumerate(dark):
        level = cv2.GaussianBlur(np.maximum(picture - rest, 0).astype(np.float32), (0, 0), 0.7)
        small, level = (cv2.morphologyEx(level, cv2.MORPH_TOPHAT, shape) / ground for shape in (spot, disc))
        top = (level >= cv2.dilate(level, np.ones((7, 7), np.uint8)) - 1e-3) & (level > BRIGHT * level.max())
        _, labels, _, centre = cv2.connectedComponentsWithStats(top.astype(np.uint8), connectivity=8)
        height = np.zeros(len(centre), np.float32)
        np.maximum.at(height, labels[top], level[top])
        strongest = np.argsort(-height)[: min(PEAKS, ALL_PEAKS // len(dark))]
        strongest = strongest[height[strongest] > 0]
        of += [j] * len(strongest)
        at += [centre[k] for k in strongest]
        x, y = np.rint(centre[strongest]).astype(int).T
        fine += (small[y, x] / level[y, x].clip(1e-6)).tolist()
    return np.array(of, int), np.array(at).reshape(-1, 2), np.array(fine, np.float32)
