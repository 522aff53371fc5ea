"""Slopes p = dz/dx and q = dz/dy of a real surface obey dp/dy = dq/dx; those of mirrored or turned normals do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float

STEEP = 0.25  # n_z below which slopes are not used
SMOOTH = 2.0  # pixels over which slopes are averaged, since noise has a curl of its own
LEAST = 200  # places where slopes are known at least
PARTS = 8  # along each side, which have to agree


class Turned(Protocol):
    """Normals with y flipped if `mirrored`, then turned by `turn_deg` about the view axis."""

    @property
    def mirrored(self) -> bool: ...

    @property
    def turn_deg(self) -> int: ...


@dataclass(frozen=True)
class Curl:
    """|A cos a - B sin a| is the curl of slopes turned by a, at m places; `weight` counts edges once.

    Parameters
    ----------
    A, B : (2, m), of the slopes as they are, and mirrored
    weight : (m,) of each place
    part : (m,) of the picture that it lies in
    """

    A: Float[np.ndarray, "2 m"]
    B: Float[np.ndarray, "2 m"]
    weight: Float[np.ndarray, " m"]
    part: np.ndarray

    @classmethod
    def of(cls, N: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> Curl | None:
        """None where slopes are known in too few places."""
        import cv2

        known = mask & (N[..., 2] > STEEP)
        z, inside = np.where(known, N[..., 2], 1), known.astype(np.float64)
        share = np.maximum(cv2.GaussianBlur(inside, (0, 0), SMOOTH), 1e-6)
        p, q = (cv2.GaussianBlur(-N[..., k] / z * inside, (0, 0), SMOOTH) / share for k in (0, 1))
        whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
        if whole.sum() < LEAST:
            return None

        def along_x(f: np.ndarray) -> np.ndarray:
            return (f[:-1, 1:] - f[:-1, :-1] + f[1:, 1:] - f[1:, :-1])[whole] / 2

        def along_y(f: np.ndarray) -> np.ndarray:  # y up: rows run against it
            return (f[:-1, :-1] - f[1:, :-1] + f[:-1, 1:] - f[1:, 1:])[whole] / 2

        p_x, p_y, q_x, q_y = along_x(p), along_y(p), along_x(q), along_y(q)
        # turned by a: p' = p cos a - q sin a, q' = p sin a + q cos a; dp'/dy - dq'/dx = A cos a - B sin a
        A, B = np.stack([p_y - q_x, p_y + q_x]), np.stack([q_y + p_x, p_x - q_y])
        size = np.hypot(A, B).sum(0)
        rows, columns = np.nonzero(whole)
        side = max(1, int(np.ceil(max(np.ptp(rows), np.ptp(columns)) / PARTS)))
        part = np.unique((rows // side) * 1000 + columns // side, return_inverse=True)[1]
        weight = np.minimum(size, np.quantile(size, 0.9)) / np.maximum(size, 1e-12)
        return cls(A, B, weight / max(float((weight * size).sum()), 1e-12), part)

    def at(self, frame: Turned) -> Float[np.ndarray, " m"]:
        """Weighted, at each place; half a turn changes nothing."""
        a, k = np.radians(frame.turn_deg), int(frame.mirrored)
        return self.weight * np.abs(self.A[k] * np.cos(a) - self.B[k] * np.sin(a))

    def total(self, frame: Turned) -> float:
        """0: a surface's, to 1."""
        return float(self.at(frame).sum())

    def certainty(self, worse: Turned, better: Turned) -> float:
        """By how many standard errors the curl is less in the parts of the picture, each counted up to the usual."""
        gain = np.bincount(self.part, self.at(worse) - self.at(better))
        most = 3 * float(np.median(np.abs(gain)))
        gain = gain.clip(-most, most)
        return float(gain.mean() / max(gain.std() / np.sqrt(max(len(gain) - 1, 1)), 1e-12))
