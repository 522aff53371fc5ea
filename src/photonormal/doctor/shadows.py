"""Cast shadows fall away from what casts them.

A sample that faces its light and is dark nevertheless lies in a cast shadow. What casts it is towards the light, and
turns its back to the light there; away from the light the shadow ends on what is lit. In a frame that is half a turn
off, all this is the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

FACING, BACK = 0.3, 0.1  # n.l of what faces a light, and of what turns its back to it
DARK = 0.35  # of what it would show, at which a sample that faces its light lies in a cast shadow
FAR = 8  # pixels that are looked along
LOW = 0.25  # sine of a light's angle to the view at least: others cast no shadow to speak of
PART = 12  # pixels along the side of the parts that have to agree
PARTS = 8  # of them, at least
CLEAR, CERTAIN = 0.35, 5.0  # mean vote of the samples or of the parts, and of these in standard errors
LEANS, FEWER = (0.1, 3.0), 4  # the same, and parts, where an outline has to say so, too


@dataclass(frozen=True)
class CastShadows:
    """Where samples lie in cast shadows, and what turns its back to each light.

    Parameters
    ----------
    at : (k, 3) light, row and column
    back : (n, h, w)
    L : (n, 3)
    """

    at: np.ndarray
    back: Bool[np.ndarray, "n h w"]
    L: Float[np.ndarray, "n 3"]

    @classmethod
    def of(
        cls,
        I: Float[np.ndarray, "p n"],
        b: Float[np.ndarray, "p 3"],
        mask: Bool[np.ndarray, "h w"],
        L: Float[np.ndarray, "n 3"],
    ) -> CastShadows:
        low = np.flatnonzero(np.hypot(L[:, 0], L[:, 1]) > LOW)
        size = np.linalg.norm(b, axis=1, keepdims=True).clip(1e-12)
        s = (b / size) @ L[low].T  # (p, m)
        back, cast = (np.zeros((len(low), *mask.shape), bool) for _ in range(2))
        back[:, mask] = (s < BACK).T
        cast[:, mask] = ((s > FACING) & (I[:, low] / size < DARK * s)).T
        return cls(np.argwhere(cast), back, L[low])

    def vote(self, M: Float[np.ndarray, "3 3"]) -> float:
        """1 where all shadows fall away from what casts them if lights are turned by M, -1 where all fall towards it.

        0 where too few say so.
        """
        return self._mean(M, CLEAR, CERTAIN, PARTS)

    def leaning(self, M: Float[np.ndarray, "3 3"]) -> float:
        """The same from less: what something else has to confirm."""
        return self._mean(M, *LEANS, FEWER)

    def _mean(self, M: Float[np.ndarray, "3 3"], clear: float, certain: float, parts: int) -> float:
        if not len(self.at):
            return 0.0
        j, row, column = self.at.T
        L = self.L @ M.T
        step = L[:, :2] / np.hypot(L[:, 0], L[:, 1])[:, None] * [1, -1]  # right and down
        nearest = []
        for side in (1, -1):
            d = np.full(len(j), FAR + 1)
            for k in range(FAR, 0, -1):
                x = column + np.rint(side * k * step[j, 0]).astype(int)
                y = row + np.rint(side * k * step[j, 1]).astype(int)
                inside = (x >= 0) & (x < self.back.shape[2]) & (y >= 0) & (y < self.back.shape[1])
                d[inside] = np.where(self.back[j[inside], y[inside], x[inside]], k, d[inside])
            nearest.append(d)
        votes = np.sign(nearest[1] - nearest[0])
        part = np.unique((row // PART) * 1000 + column // PART, return_inverse=True)[1]
        of_part = np.bincount(part, votes) / np.bincount(part)
        error = of_part.std() / np.sqrt(len(of_part)) + 1e-3
        all_votes, mean = float(votes.mean()), float(of_part.mean())
        clear_enough = len(of_part) >= parts and abs(mean) > certain * error and max(abs(mean), abs(all_votes)) > clear
        return mean if clear_enough and mean * all_votes > 0 else 0.0
