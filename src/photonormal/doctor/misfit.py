"""How badly a matt surface explains the pictures, and by how much less after something is changed.

The same lit samples of the same pixels are asked before and after. What changes for the better by chance, or by shine
that another model mimics in places, does not in every part of the object.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.calibration.intensities import SHADOW

PIXELS = 1500  # looked at
LEAST = 100  # pixels that show anything
FEW = 6  # lit samples of a pixel at least: fewer fit whatever they show
SIDE = 6  # parts along each side
OF_PART = 8  # pixels in a part at least
KEPT = 0.6  # of a pixel's lit samples whose residual counts: shadows and highlights are among the others
TIGHT, ROUNDS = 1.5, 4  # residuals beyond so many of those don't show the fit
MATT = 0.06  # misfit, as part of a pixel's level, above which shine mimics other angles and intensities
NOISE = 1e-4  # of a pixel's level that no misfit falls below
CERTAIN = 3.0  # standard errors over the parts


@dataclass(frozen=True)
class MisfitPixels:
    """Some of the object's pixels with samples enough.

    Parameters
    ----------
    I : (p, n) grey levels, 1 at their brightest
    lit : (p, n) samples that are not in shadow
    place : (p, 2) column and row, counted upwards, from the middle, in widths of the object
    part : (p,) of the object, numbered from 0
    """

    I: Float[np.ndarray, "p n"]
    lit: Bool[np.ndarray, "p n"]
    place: Float[np.ndarray, "p 2"]
    part: Int[np.ndarray, " p"]

    @classmethod
    def of(cls, I: Float[np.ndarray, "p n"], mask: Bool[np.ndarray, "h w"]) -> MisfitPixels | None:
        """None where too few samples are lit."""
        step = max(1, len(I) // PIXELS)
        some, (rows, columns) = I[::step], np.argwhere(mask)[::step].T
        lit = some > SHADOW * np.quantile(some, 0.99)
        enough = lit.sum(1) >= FEW
        if enough.sum() < LEAST:
            return None
        x, y = columns[enough].astype(float), -rows[enough].astype(float)
        width = max(np.ptp(x), np.ptp(y)) + 1
        place = np.stack([x - x.mean(), y - y.mean()], axis=-1) / width
        cell = ((place - place.min(0)) * SIDE).astype(int).clip(0, SIDE - 1) @ [1, SIDE]
        part = np.unique(cell, return_inverse=True)[1]
        return cls(some[enough] / some.max(), lit[enough], place, part)

    def showing(self, I: Float[np.ndarray, "p n"]) -> MisfitPixels:
        """Other grey levels, of which the same samples are asked."""
        return replace(self, I=I)

    def duller(self, part: float) -> MisfitPixels:
        """Without that part of each pixel's lit samples that is brightest, as far as enough are left."""
        count = self.lit.sum(1)
        rank = np.where(self.lit, -self.I, np.inf).argsort(axis=1).argsort(axis=1)
        left_out = np.minimum((part * count).astype(int), count - FEW)
        return replace(self, lit=self.lit & (rank >= left_out[:, None]))

    @property
    def level(self) -> Float[np.ndarray, " p"]:
        """Mean of each pixel's lit samples."""
        return (self.I * self.lit).sum(1) / self.lit.sum(1)

    def fit(self, L: Float[np.ndarray, "*p n k"]) -> tuple[Float[np.ndarray, "p k"], Float[np.ndarray, " p"]]:
        """b (p, k) such that I = max(L b, 0) on most lit samples, and what is left, as part of the pixel's level.

        A fourth column of L, all ones, stands for light that shadows don't take away.
        """
        k, w, count = L.shape[-1], self.lit.astype(float), self.lit.sum(1)
        LL = (L[..., :, None] * L[..., None, :]).reshape(*L.shape[:-1], k * k)
        b = left = np.zeros(())
        for _ in range(ROUNDS):
            if L.ndim == 2:
                A, y = (w @ LL).reshape(-1, k, k), (w * self.I) @ L
            else:
                A, y = np.einsum("pn,pnk->pk", w, LL).reshape(-1, k, k), np.einsum("pn,pnk->pk", w * self.I, L)
            ridge = 1e-5 * np.trace(A, axis1=1, axis2=2) / k + 1e-9
            b = np.linalg.solve(A + ridge[:, None, None] * np.eye(k), y[..., None])[..., 0]
            shading = b[:, :3] @ L[:, :3].T if L.ndim == 2 else np.einsum("pk,pnk->pn", b, L)
            r = np.abs(self.I - shading.clip(0) - (b[:, 3:] if k > 3 else 0))
            ranked = np.sort(np.where(self.lit, r, np.inf), axis=1)
            left = ranked[np.arange(len(r)), ((count - 1) * KEPT).astype(int)]
            w = (self.lit & (shading > 0) & (r <= TIGHT * left[:, None] + 1e-9)).astype(float)
        return b, left / self.level.clip(1e-9) * np.sqrt(count / (count - k))

    def gain(
        self,
        before: Float[np.ndarray, " p"],
        after: Float[np.ndarray, " p"],
        where: Bool[np.ndarray, " p"] | None = None,
    ) -> Gain:
        """How much less is left `after`, in the pixels `where`; in all of them without it."""
        some = np.ones(len(before), bool) if where is None else where
        change, part = np.log((after + NOISE) / (before + NOISE))[some], self.part[some]
        parts = [change[part == k] for k in range(self.part.max() + 1)]
        middle = np.array([np.median(c) for c in parts if len(c) >= OF_PART])
        if len(middle) < 3:
            return Gain(1.0, 0.0)
        error = middle.std() / np.sqrt(len(middle)) + 1e-3
        return Gain(float(np.exp(np.median(change))), float(-middle.mean() / error))


@dataclass(frozen=True)
class Gain:
    """What is left of a misfit, as part of what was, and standard errors by which it is less in the object's parts."""

    left: float
    errors: float

    def below(self, limit: float, certain: float = CERTAIN) -> bool:
        """Certainly less than this part is left."""
        return self.errors > certain and self.left < limit
