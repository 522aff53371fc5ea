"""Whether a sphere's circle explains the shadows around it.

Where lamps are mirrored inside a circle shows their directions, and they show which parts of the table a sphere of that
size keeps from each lamp. The outline of another thing, a base below the ball, the table's horizon in it, means other
lights and another sphere, and its shadows would lie elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibration.circle import Circle
from photonormal.calibration.mirror import directions
from photonormal.calibration.outline import EDGE_POWER
from photonormal.geometry import normalised

LIT = 0.3  # part of the middle brightness above which a place shows how bright a picture is
REACH = (1.06, 3.5)  # from where to where around a sphere shadows are compared, in its radii
PLACES = 2500  # that are compared, about
FACING = 0.7  # cosine between the view and a table's normal below which the shading did not show it
GAMMAS = (2.0, 4.4)  # powers that make square roots of levels light, stored linear or encoded
STILL = 0.6  # quantile of a place's brightness that no highlight and no shadow has
BLUR = 1.5  # pixels of the photographs beside an outline that show both sides
WRONG = 0.1  # part of the pictures whose highlight may be another thing's
SHADED = 0.5  # part of the light that is missing from which a place is in shadow
SEEN = 0.01  # part of the places in shadow from which a picture's shadow shows something
NEAREST = 0.12  # a sphere's radius as a part of the lamps' distance, at most
CLEARLY = 0.2  # by how much the shadow of one reflection has to be explained better than another's
VIEW = np.array([0.0, 0.0, 1.0])
FEW = 4  # pictures below which a place's middle brightness may be in shadow


@dataclass(frozen=True)
class Surroundings:
    """What `n` photographs of a place (a, b) show: the same place under the middle light, and what is dark in each.

    Parameters
    ----------
    still : square roots of levels, without highlights and with few shadows
    missing : part of the light in `still` that each picture lacks once it is divided by its brightness
    bright : terms of 1, x and y of the logarithm of each picture's brightness: near lamps light their own side more
    lit : where it is known
    deep : what is missing in a shadow; other light, which comes from everywhere, is left
    blur : pixels beside an outline that show both sides
    """

    still: Float[np.ndarray, "a b"]
    missing: Float[np.ndarray, "n a b"]
    bright: Float[np.ndarray, "n 3"]
    lit: Bool[np.ndarray, "a b"]
    deep: float
    blur: float

    @classmethod
    def of(cls, roots: Sequence[Float[np.ndarray, "a b"]], pixel: float = 1.0) -> Surroundings:
        """From square roots of grey levels; `pixel` is the width of a photograph's pixel in them."""
        stack = np.stack(roots).clip(0)
        middle = np.median(stack, axis=0)
        lit = middle > LIT * np.median(middle)
        y, x = np.nonzero(lit)
        some = slice(None, None, max(1, x.size // PLACES))
        A = np.stack([np.ones_like(x), x, y], axis=-1)[some].astype(float)  # (p, 3)
        bright = np.stack([_plane(A, np.log((picture[lit] / middle[lit])[some].clip(LIT / 10))) for picture in stack])
        y, x = np.mgrid[: middle.shape[0], : middle.shape[1]].astype(np.float32)
        light = (np.exp(b[0] + b[1] * x + b[2] * y) for b in bright.astype(np.float32))
        even = np.stack([picture / b for picture, b in zip(stack, light, strict=True)])
        still = np.quantile(even, STILL, axis=0)
        missing = (1 - (even / still.clip(1e-3)) ** EDGE_POWER).clip(0, 1)
        shaded = missing[:, lit][missing[:, lit] > SHADED]
        return cls(still, missing, bright, lit, float(np.median(shaded)) if shaded.size else 1.0, BLUR * pixel)

    def explained(self, circle: Circle, xy: Float[np.ndarray, "n 2"]) -> float:
        """Correlation, over places and pictures, of what is dark with the shadows of the sphere of that circle.

        A few pictures may show another thing's highlight: those that fit worst don't count.

        Parameters
        ----------
        xy : where the sphere mirrors the lamps, NaN where it does not
        """
        return self.compared(circle, xy).correlation

    def of_each(self, circle: Circle, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """The same for each picture by itself; NaN where it has no highlight, or hardly a shadow."""
        return self.compared(circle, xy).of_each(xy)

    def chosen(
        self, circle: Circle, xy: Float[np.ndarray, "n 2"], others: Float[np.ndarray, "k n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
        """Of several reflections in a picture the one whose shadow it shows; and where that is clear of all of them.

        Parameters
        ----------
        xy : the reflections that stand out farthest, which stay where their shadows show nothing
        others : further ones, NaN where there are none
        """
        compared = self.compared(circle, xy)  # on the table that these show
        of = np.nan_to_num([compared.of_each(reflections) for reflections in (xy, *others)])  # (1 + k, n)
        best = np.where(of.max(0) > of[0] + CLEARLY, of.argmax(0), 0)
        picture = np.arange(len(xy))
        clear = (of > of[best, picture] - CLEARLY).sum(0) == 1
        return np.stack([xy, *others])[best, picture], clear

    def fitted(self, circle: Circle, xy: Float[np.ndarray, "n 2"]) -> Circle:
        """The circle close to another one that explains the shadows best."""
        from scipy.optimize import minimize

        def of(p: np.ndarray) -> Circle:
            x, y, r = circle.x + p[0] * circle.r, circle.y + p[1] * circle.r, circle.r * np.exp(p[2])
            return replace(circle, x=x, y=y, r=r)

        simplex = np.vstack([np.zeros(3), np.diag([0.1, 0.1, 0.15])])
        how = {"initial_simplex": simplex, "maxfev": 120, "xatol": 0.003, "fatol": 1e-4}
        return of(minimize(lambda p: -self.explained(of(p), xy), np.zeros(3), method="Nelder-Mead", options=how).x)

    def compared(
        self, circle: Circle, xy: Float[np.ndarray, "n 2"], table: Float[np.ndarray, " 3"] | None = None
    ) -> ShadowMatch:
        """Levels are taken for linear or encoded, whichever explains more; the table's normal is found, or given."""
        shown = np.isfinite(xy.sum(1))
        x, y, dark = self._around(circle)
        if shown.sum() < FEW or x.size < PLACES / 40:
            return ShadowMatch(0.0, shown, VIEW, 1.0, np.zeros((0, 0)), lambda reflections: np.zeros((0, 0)))
        (L, _), dark, bright = directions(circle, xy[shown]), dark[shown], self.bright[shown]
        found = []
        for gamma in GAMMAS:
            T, unsure = _table(L, np.exp(gamma * bright @ (1.0, circle.x, circle.y))) if table is None else (table, 0.0)
            lamps = 1 - (1 - self.deep) ** (gamma / EDGE_POWER)  # of all light
            cast = partial(_cast, circle, T, x, y, _near(circle, L, T, gamma / lamps * bright[:, 1:]))
            S = cast(xy[shown])
            less = 1 - (1 - dark) ** (gamma / EDGE_POWER)  # of light: edges are where it is half way
            left = np.nan_to_num(_correlation(less, S), nan=1.0).argsort()[int(WRONG * len(S)) :]
            correlation = float(np.nan_to_num(_correlation(less[left].ravel(), S[left].ravel())))
            found.append(ShadowMatch(correlation, shown, T, unsure, less, cast))
        return max(found, key=lambda compared: compared.correlation)

    def _around(self, circle: Circle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lit places (p,) around a circle: x, y, and what is missing (n, p)."""
        a, b = self.lit.shape
        near, far = REACH[0] * circle.r + self.blur, REACH[1] * circle.r
        top, left = max(0, int(circle.y - far)), max(0, int(circle.x - far))
        step = max(1, int(np.sqrt(np.pi * far**2 / PLACES)))
        y, x = np.mgrid[top : min(a, int(circle.y + far) + 1) : step, left : min(b, int(circle.x + far) + 1) : step]
        away = np.hypot(x - circle.x, y - circle.y)
        there = (away > near) & (away < far) & self.lit[y, x]
        x, y = x[there], y[there]
        return x, y, self.missing[:, y, x]


class ShadowMatch(NamedTuple):
    """What is dark around a sphere, and its shadows there, in the `m` of n pictures with a highlight.

    Parameters
    ----------
    correlation : of both, over places and pictures
    shown : (n,) which pictures these are
    table : its normal, as its light shows it
    unsure : standard deviation of that across the view
    dark : (m, p) what is missing at p places
    cast : the shadows (m, p) of the sphere under lights that it mirrors at (m, 2)
    """

    correlation: float
    shown: Bool[np.ndarray, " n"]
    table: Float[np.ndarray, " 3"]
    unsure: float
    dark: Float[np.ndarray, "m p"]
    cast: Callable[[np.ndarray], np.ndarray]

    def of_each(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Correlation in each picture; NaN where it has no highlight, or hardly a shadow."""
        found = np.full(len(xy), np.nan)
        if len(self.dark):
            S = self.cast(xy[self.shown])
            found[self.shown] = np.where(S.mean(1) > SEEN, _correlation(self.dark, S), np.nan)
        return found


def _cast(
    circle: Circle,
    T: Float[np.ndarray, " 3"],
    x: np.ndarray,
    y: np.ndarray,
    near: float,
    xy: Float[np.ndarray, "m 2"],
) -> Float[np.ndarray, "m p"]:
    """Shadows of a sphere on the table T at the places x, y under lights that it mirrors at `xy`."""
    L, N = directions(circle, xy)
    return shadows(circle, normalised(L + near * N), T, x, y, near).astype(float)  # L is from where it is mirrored


def _table(L: Float[np.ndarray, "m 3"], e: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, " 3"], float]:
    """The normal of what most of a place shows, by its light `e` in each picture, and how unsure it is across the view.

    It is the view where the light shows none.
    """
    b = np.linalg.lstsq(L, e, rcond=None)[0]
    left = np.abs(L @ b - e).argsort()[: len(e) - int(WRONG * len(e))]
    b = np.linalg.lstsq(L[left], e[left], rcond=None)[0]
    T = normalised(b)
    if T[2] <= FACING:
        return VIEW, 1.0
    off2 = ((L[left] @ b - e[left]) ** 2).sum() / max(1, len(left) - 3)
    spread = off2 * np.linalg.pinv(L[left].T @ L[left]) / (b @ b)  # (3, 3)
    return T, float(np.sqrt((spread[0, 0] + spread[1, 1]) / 2))


def _near(
    circle: Circle, L: Float[np.ndarray, "m 3"], T: Float[np.ndarray, " 3"], slopes: Float[np.ndarray, "m 2"]
) -> float:
    """A sphere's radius as a part of the lamps' distance from it, from how they light a plane.

    The light of a lamp at distance d on a plane is T.(p - x) / |p - x|^3, so that its logarithm grows by 3 (l.v) / d
    along v in the plane. What all pictures share, as by vignetting, shows nothing.

    Parameters
    ----------
    slopes : of the logarithm of the light, in pixels, x to the right and y down
    """
    along = L[:, :2] - L[:, 2:] * T[:2] / T[2]
    along, grown = (a - a.mean(0) for a in (along, slopes * (1, -1)))
    near = max(0.0, float(circle.r * (along * grown).sum() / max(3 * (along**2).sum(), 1e-9)))
    return min(near / max(1 - near * float((L @ T).mean()), 0.5), NEAREST)  # the plane is farther than the sphere


def _plane(A: Float[np.ndarray, "p 3"], values: Float[np.ndarray, " p"]) -> Float[np.ndarray, " 3"]:
    """The plane of most values: least squares with Geman and McClure's weights, begun at their median."""
    found = np.array([np.median(values), 0.0, 0.0])
    for _ in range(8):
        off = values - A @ found
        s = max(2 * float(np.median(np.abs(off))), 1e-3)
        w = 1 / (1 + (off / s) ** 2)
        found = np.linalg.lstsq(A * w[:, None], values * w, rcond=None)[0]
    return found


def _correlation(a: Float[np.ndarray, "*m p"], b: Float[np.ndarray, "*m p"]) -> Float[np.ndarray, "*m"]:
    """Along the last axis; NaN where one of the two is even."""
    a, b = (c - c.mean(-1, keepdims=True) if c.size else c for c in (a, b))
    size = np.sqrt((a**2).sum(-1) * (b**2).sum(-1))
    return (a * b).sum(-1) / np.where(size > 0, size, np.nan)


def shadows(
    circle: Circle,
    L: Float[np.ndarray, "n 3"],
    T: Float[np.ndarray, " 3"],
    x: Float[np.ndarray, " p"],
    y: Float[np.ndarray, " p"],
    near: float = 0.0,
) -> Bool[np.ndarray, "n p"]:
    """True where a sphere keeps lamps from pixels of the plane of normal `T` that it rests on.

    Parameters
    ----------
    L : directions from the sphere's centre to the lamps
    near : the sphere's radius as a part of their distance; 0: distant
    """
    dx, dy = (x - circle.x) / circle.r, (circle.y - y) / circle.r
    V = -np.stack([dx, dy, (-1 - T[0] * dx - T[1] * dy) / T[2]], axis=-1)  # (p, 3) to the sphere's centre, in radii
    v2, across = (V**2).sum(-1), L @ V.T
    size = np.sqrt(1 + 2 * near * across + near**2 * v2).clip(1e-9)  # of L + near V
    along = (across + near * v2) / size  # V . (L + near V), made unit
    return (along > 0) & (v2 - along**2 < 1)
