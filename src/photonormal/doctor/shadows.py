"""Cast shadows lie where the surface rises above the light's ray.

From each pixel the surface that the lights show is walked towards every light: where it rises above the ray, the pixel
lies in a cast shadow. In a frame that is half a turn off, the same surface turned inside out has its shadows elsewhere,
where the walk away from the light rises. Where only one of both says so, a sample that is darker than others alike
speaks for the one, and one that is not for the other. Alike are samples whose normals stand alike to light and view, so
that no material, however it shines, looks like shadows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from photonormal.doctor.laid import at_most
from photonormal.geometry import normalised

FACING = 0.15  # n.l of what faces a light
DARK = 0.35  # of what it would show, at which such a sample may lie in a cast shadow
COSINES, HALFWAY = 12, 16  # classes of n.l and of n.h, in each of which samples are alike
FAR = 24  # pixels that are walked
STEEP = 0.15  # n_z below which slopes count as if it were that
LOW = 0.25  # sine of a light's angle to the view at least: others cast no shadow to speak of
LIGHTS = 16  # that are looked at, at most
PART = 12  # pixels along the side of the parts that have to agree
SAMPLES = 30  # on each side, at least
CLEAR, CERTAIN, PARTS = 0.25, 3.5, 8  # by how much more often samples are dark, standard errors over parts and over
# lights, and parts, at least
LEANS = 0.06, 2.5, 4  # the same where an outline has to say so, too


@dataclass(frozen=True)
class CastShadows:
    """Which samples are dark, and how the surface rises over each light's ray.

    Parameters
    ----------
    facing : (n, h, w) samples that face their light
    darker : (n, h, w) 1 where those are dark, less the part that is dark of those alike
    rise : (n, h + 2 FAR, w + 2 FAR) of the surface above the ray over a pixel towards the light; NaN off the mask
    L : (n, 3)
    """

    facing: Bool[np.ndarray, "n h w"]
    darker: Float[np.ndarray, "n h w"]
    rise: Float[np.ndarray, "n H W"]
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
        low = at_most(low, LIGHTS)
        I, L, size = I[:, low], L[low], np.linalg.norm(b, axis=1, keepdims=True).clip(1e-12)
        N = b / size
        s, nh = N @ L.T, (N @ normalised(L + np.array([0.0, 0.0, 1.0])).T).clip(0, 1)  # (p, m)
        facing = s > FACING
        dark = (I / size < DARK * s)[facing]
        angles = (s * COSINES).astype(int) * (HALFWAY + 1) + (nh * HALFWAY).astype(int)
        alike = (angles + np.arange(len(low)) * (COSINES + 1) * (HALFWAY + 1))[facing]
        usual = np.bincount(alike, dark) / np.bincount(alike).clip(1)
        darker = np.zeros(s.shape)
        darker[facing] = dark - usual[alike]
        across = np.hypot(L[:, 0], L[:, 1])
        rise = -(N[:, :2] / N[:, 2:].clip(STEEP)) @ (L[:, :2] / across[:, None]).T - L[:, 2] / across

        def maps(v: np.ndarray, elsewhere: float) -> np.ndarray:
            found = np.full((len(low), *mask.shape), elsewhere, v.dtype)
            found[:, mask] = v.T
            return found

        walked = np.pad(maps(rise.astype(np.float32), np.nan), ((0, 0), (FAR, FAR), (FAR, FAR)), constant_values=np.nan)
        return cls(maps(facing, False), maps(darker.astype(np.float32), 0), walked, L)

    def vote(self, M: Float[np.ndarray, "3 3"]) -> float:
        """Above 0 where shadows lie as the surface casts them if lights are turned by M, below where half a turn on.

        By how much more often samples are dark in the one's shadows than in the other's; 0 where it is too little, may
        be chance, or one of both casts none.
        """
        return self._more(M, CLEAR, CERTAIN, PARTS)

    def leaning(self, M: Float[np.ndarray, "3 3"]) -> float:
        """The same from less: what something else has to confirm."""
        return self._more(M, *LEANS)

    def _more(self, M: Float[np.ndarray, "3 3"], clear: float, certain: float, parts: int) -> float:
        towards = (self.L @ M.T)[:, :2]
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        says = np.stack(
            [above_ray(r, t).astype(int) - above_ray(r, -t) for r, t in zip(self.rise, towards, strict=True)]
        )
        sides = [self.facing & (says == side) for side in (1, -1)]
        if min(int(side.sum()) for side in sides) < SAMPLES:
            return 0.0
        more, off = 0.0, np.zeros(says.shape)
        for side, sign in zip(sides, (1, -1), strict=True):
            darker = self.darker[side]
            more += sign * float(darker.mean())
            off[side] = sign * (darker - darker.mean()) / len(darker)
        light, row, column = np.nonzero(sides[0] | sides[1])
        off = off[light, row, column]
        of_part = np.bincount(np.unique((row // PART) * 1000 + column // PART, return_inverse=True)[1], off)
        error = max(float(np.sqrt((sums**2).sum())) for sums in (of_part, np.bincount(light, off)))
        return more if len(of_part) >= parts and abs(more) > max(clear, certain * error) else 0.0


def above_ray(rise: Float[np.ndarray, "H W"], towards: Float[np.ndarray, " 2"]) -> Bool[np.ndarray, "h w"]:
    """Where the surface, walked from a pixel in a direction (x, y), gets above the ray, before it leaves the mask."""
    h, w = (side - 2 * FAR for side in rise.shape)
    here = rise[FAR : FAR + h, FAR : FAR + w]
    above = highest = np.zeros_like(here)
    for k in range(1, FAR + 1):
        row, column = FAR - round(k * towards[1]), FAR + round(k * towards[0])
        there = rise[row : row + h, column : column + w]
        above = above + (here + there) / 2
        highest, here = np.fmax(highest, above), there
    return highest > 0
