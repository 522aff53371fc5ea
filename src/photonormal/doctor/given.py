"""The lights as they were given, distant or near, and what the pictures would show under distant ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float, Int

from photonormal.calibration.intensities import SHADOW, robust_normals
from photonormal.geometry import normalised
from photonormal.shading import FAINT, fall_off, towards
from photonormal.types import Lamps

SAMPLES = 2**20  # of pictures that are changed at a time


class Given(Protocol):
    """Grey levels of `p` pixels under `n` lights, and where the lights are said to be."""

    @property
    def levels(self) -> Float[np.ndarray, "p n"]: ...

    @property
    def vectors(self) -> Float[np.ndarray, "n 3"]:
        """As a file holds them: unit vectors, or positions in mm."""
        ...

    def directions(self) -> Float[np.ndarray, "n 3"]:
        """Unit vectors to the lights from the object's middle."""
        ...

    def seen(self) -> Float[np.ndarray, "p n"]:
        """Grey levels that distant lights of those directions would give."""
        ...

    def showing(self, I: Float[np.ndarray, "p n"]) -> Given:
        """Other grey levels."""
        ...

    def reordered(self, order: Int[np.ndarray, " n"]) -> Given:
        """Light i belongs to picture order[i] instead."""
        ...

    def turned(self, M: Float[np.ndarray, "3 3"]) -> Given:
        """All vectors v are M v instead."""
        ...


@dataclass(frozen=True)
class Distant:
    """Lights of one direction for all pixels."""

    levels: Float[np.ndarray, "p n"]
    vectors: Float[np.ndarray, "n 3"]

    def directions(self) -> Float[np.ndarray, "n 3"]:
        return self.vectors

    def seen(self) -> Float[np.ndarray, "p n"]:
        return self.levels

    def showing(self, I: Float[np.ndarray, "p n"]) -> Distant:
        return replace(self, levels=I)

    def reordered(self, order: Int[np.ndarray, " n"]) -> Distant:
        return replace(self, vectors=self.vectors[np.argsort(order)])

    def turned(self, M: Float[np.ndarray, "3 3"]) -> Distant:
        return replace(self, vectors=self.vectors @ M.T)


@dataclass(frozen=True)
class Near:
    """Lamps whose distance matters, over pixels that lie at `X` (p, 3) mm; a plane at the mean depth is good enough."""

    levels: Float[np.ndarray, "p n"]
    X: Float[np.ndarray, "p 3"]
    lamps: Lamps

    @property
    def vectors(self) -> Float[np.ndarray, "n 3"]:
        return self.lamps.positions_mm

    @property
    def middle(self) -> Float[np.ndarray, " 3"]:
        """Of the object."""
        return self.X.mean(0)

    @property
    def distances(self) -> Float[np.ndarray, " n"]:
        """Of the lamps from there."""
        return np.linalg.norm(self.vectors - self.middle, axis=1)

    def directions(self) -> Float[np.ndarray, "n 3"]:
        return normalised(self.vectors - self.middle)

    def seen(self) -> Float[np.ndarray, "p n"]:
        """Divided by the light that arrives, and I + b.(l - l_p) with each pixel's least-squares b under its own l_p.

        Exact on a matt plane; what is dark stays as it is.
        """
        straight = self.directions()
        dark = SHADOW * float(np.quantile(self.levels, 0.99))

        def moved(I: np.ndarray, L: np.ndarray, e: np.ndarray) -> np.ndarray:
            J = I * np.where(e > FAINT, 1 / np.maximum(e, FAINT), 0)
            b = fitted(J, L, (J > dark).astype(float))
            return np.where(J > dark, np.maximum(J + ((straight - L) @ b[..., None])[..., 0], 0), J)

        return self._by_blocks(moved)

    def _by_blocks(self, f: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]) -> Float[np.ndarray, "p n"]:
        """``f(I, L, e)`` of some pixels at a time, to bound the memory; e is 1 at the lamps' mean distance."""
        step = max(1, SAMPLES // len(self.vectors))
        r0 = self.distances.mean()
        found = []
        for k in range(0, len(self.levels), step):
            L, e = arriving(self.X[k : k + step], self.lamps)
            found.append(f(self.levels[k : k + step], L, r0**2 * e))
        return np.concatenate(found)

    def showing(self, I: Float[np.ndarray, "p n"]) -> Near:
        return replace(self, levels=I)

    def reordered(self, order: Int[np.ndarray, " n"]) -> Near:
        return replace(self, lamps=self.lamps[np.argsort(order).tolist()])

    def turned(self, M: Float[np.ndarray, "3 3"]) -> Near:
        return replace(self, lamps=Lamps(self.vectors @ M.T, self.lamps.axes @ M.T, self.lamps.mu))

    def scaled(self, factor: float) -> Near:
        """As if all lamps were so many times as far from the object's middle."""
        S = self.middle + factor * (self.vectors - self.middle)
        return replace(self, lamps=Lamps(S, self.lamps.axes, self.lamps.mu))


def arriving(X: Float[np.ndarray, "p 3"], lamps: Lamps) -> tuple[Float[np.ndarray, "p n 3"], Float[np.ndarray, "p n"]]:
    """Unit vectors from points to the lamps, and what arrives of their light, cos^mu / r^2."""
    S, axes, mu = (torch.from_numpy(v) for v in (lamps.positions_mm, lamps.axes, lamps.mu))
    L, r = towards(torch.from_numpy(X), S)
    return L.numpy(), fall_off(L, r, axes, mu).numpy()


def fitted(
    J: Float[np.ndarray, "p n"], L: Float[np.ndarray, "p n 3"], w: Float[np.ndarray, "p n"]
) -> Float[np.ndarray, "p 3"]:
    """b = argmin sum_j w_j (l_j.b - J_j)^2, each pixel with its own lights; short where that is not fixed."""
    Lw = (L * w[..., None]).swapaxes(1, 2)
    return np.linalg.solve(Lw @ L + 1e-6 * np.eye(3), Lw @ J[..., None])[..., 0]


def matt_misfit(given: Given, step: int = 1) -> float:
    """Median of |I - l.b| / |b| over lit samples of every `step`-th pixel."""
    I, L = given.seen()[::step], given.directions()
    lit = I > SHADOW * np.quantile(I, 0.99)
    b = robust_normals(I, L, lit)
    r = np.abs(I - b @ L.T) / np.linalg.norm(b, axis=1, keepdims=True).clip(1e-12)
    return float(np.median(r[lit])) if lit.any() else 0.0
