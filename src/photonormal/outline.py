"""Normals along an object's occluding outline, where its surface turns away from the camera, point outwards.

The rim of a mask drawn on something flat is no such outline: normals there face the camera, and say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

LEAST = 60  # pixels of an outline
TURNED_AWAY = 0.6  # n_z at an outline, as a rule, where the surface turns away from the camera
CLEAR = 0.7  # by how much its normals have to point outwards, or inwards, of 1


@dataclass(frozen=True)
class Outline:
    """Normals at the outline and the directions outwards there, in the picture's x and y."""

    n: Float[np.ndarray, "m 3"]
    away: Float[np.ndarray, "m 2"]

    @classmethod
    def of(cls, N: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> Outline | None:
        """None where the frame cuts the mask."""
        import cv2

        padded = cv2.copyMakeBorder(mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
        edge = mask & (cv2.erode(padded, np.ones((5, 5), np.uint8))[1:-1, 1:-1] == 0)
        edge[:3] = edge[-3:] = False
        edge[:, :3] = edge[:, -3:] = False
        if edge.sum() < LEAST:
            return None
        soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 3.0)
        away = np.stack([-cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)], axis=-1)[edge]
        return cls(N[edge], away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9))

    def outwards(self, M: Float[np.ndarray, "3 3"]) -> float:
        """1 where all of its normals, turned by M, point outwards, -1 where all point inwards."""
        n = (self.n @ M.T)[:, :2]
        return float((n * self.away).sum() / max(np.linalg.norm(n, axis=1).sum(), 1e-9))

    def leaning(self, M: Float[np.ndarray, "3 3"]) -> float:
        """`outwards` where that is clearly to one side, as at the rim of a coin, too; else 0."""
        value = self.outwards(M)
        return value if abs(value) > CLEAR else 0.0

    def vote(self, M: Float[np.ndarray, "3 3"]) -> float:
        """The same where the surface turns away there; 0 where the outline says nothing."""
        return self.leaning(M) if float(np.median(self.n[:, 2])) < TURNED_AWAY else 0.0
