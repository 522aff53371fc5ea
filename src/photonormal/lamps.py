"""Where lights and camera are: lamps near the object, what a pixel is in millimetres, directions of distant lights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.errors import InputError

UNITS = {10: "centimetres", 25.4: "inches", 1000: "metres"}  # millimetres that each holds
FARTHEST = 100  # of an object's radius, that lamps are far away
BEHIND = -1e-6  # z of a unit direction below which it comes from behind; what is above is rounding
COPLANAR = 1000.0  # condition number of the lights above which three dimensions are not spanned in practice


@dataclass(frozen=True)
class Camera:
    """Where a pixel's surface lies in millimetres.

    Parameters
    ----------
    mm_per_px : side of a pixel at the object's mean depth
    K : (3, 3) camera matrix in pixels (x right, y down, the first pixel's centre at (0, 0)) of a perspective view;
        the mean depth is then K[0, 0] mm_per_px. None: an orthographic view
    """

    mm_per_px: float
    K: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mm_per_px) and self.mm_per_px > 0):
            raise InputError(f"a pixel is {self.mm_per_px} mm wide but a length above 0 is needed; measure one.")

    def points_mm(self, depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
        """Positions, from depth as `photonormal.types.Surface` has it; unknown depth (NaN) counts as the mean."""
        h, w = depth.shape
        if self.K is None:
            y, x = np.mgrid[:h, :w]
            return self.mm_per_px * np.stack([x - (w - 1) / 2, (h - 1) / 2 - y, np.nan_to_num(depth, nan=0)], axis=-1)
        return self.K[0, 0] * self.mm_per_px * np.nan_to_num(depth, nan=1)[..., None] * self.rays(h, w)

    def rays(self, h: int, w: int) -> Float[np.ndarray, "h w 3"]:
        """From the camera to each pixel's surface, of length one along the optical axis."""
        y, x = np.mgrid[:h, :w]
        if self.K is None:
            return np.broadcast_to([0.0, 0.0, -1.0], (h, w, 3))
        return np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(self.K).T * [1, -1, -1]

    def plane_mm(self, h: int, w: int) -> Float[np.ndarray, "h w 3"]:
        """Positions of all pixels on a plane at the object's mean depth."""
        return self.points_mm(np.full((h, w), np.nan))

    def flat_mm(self, mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "p 3"]:
        """Those of the mask's pixels."""
        return self.plane_mm(*mask.shape)[mask]


@dataclass(frozen=True)
class Lamps:
    """`n` small lights whose distance from the object matters.

    Lamp j lights a point at distance r and at an angle a off its axis by (r0 / r)^2 cos^mu(a), where r0 is the mean
    distance of all lamps from the object's middle. What images were divided by are the lamps' own intensities.

    Parameters
    ----------
    positions_mm : (n, 3)
    axes : (n, 3), any length but zero, where each lamp shines most; kept as unit vectors. None: towards -z
    mu : (n,) exponents of the fall-off from the axes, at least 0; 1 is a Lambertian lamp. None: 0, evenly to all sides
    """

    positions_mm: np.ndarray
    axes: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    mu: np.ndarray = None  # pyright: ignore[reportAssignmentType]

    def __post_init__(self) -> None:
        S = np.asarray(self.positions_mm, np.float64)
        if S.ndim != 2 or S.shape[1] != 3 or not np.isfinite(S).all():
            raise InputError(f"the lamps' positions are {S.shape} but finite (n, 3) are needed; give millimetres.")
        n = len(S)
        axes = np.tile([0.0, 0, -1], (n, 1)) if self.axes is None else np.asarray(self.axes, np.float64)
        mu = np.zeros(n) if self.mu is None else np.asarray(self.mu, np.float64)
        length = np.linalg.norm(axes, axis=-1, keepdims=True)
        if (
            axes.shape != (n, 3)
            or mu.shape != (n,)
            or not (np.isfinite(length) & (length > 0)).all()
            or not (mu >= 0).all()
        ):
            raise InputError(
                f"the lamps' axes are {axes.shape} and mu {mu.shape} but ({n}, 3), none of them zero, and ({n},), none "
                "below 0, are needed; correct them."
            )
        for name, value in {"positions_mm": S, "axes": axes / length, "mu": mu}.items():
            object.__setattr__(self, name, value)

    def __getitem__(self, chosen: Sequence[int]) -> Lamps:
        """Some of the lamps."""
        some = list(chosen)
        return Lamps(self.positions_mm[some], self.axes[some], self.mu[some])


def lights_behind(L: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " k"]:
    """Which lights, unit directions, come from behind the object: z below 0, so that what faces the camera is dark."""
    return np.flatnonzero(L[:, 2] < BEHIND)


def unit_lights(lights: Any, names: Sequence[str]) -> Float[np.ndarray, "n 3"]:
    """Light directions of the images `names` as unit vectors (n, 3), float64; InputError where they can't be used."""
    n = len(names)
    try:
        L = np.asarray(lights, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"lights are {str(lights)[:60]!r} but numbers ({n}, 3) are needed; give an array.") from None
    if L.shape == (3, n) and n != 3:
        raise InputError(f"lights are (3, {n}) but ({n}, 3) is needed, a row for each image; transpose them.")
    if L.shape != (n, 3):
        raise InputError(
            f"lights are {L.shape} but {n} images need ({n}, 3); give one direction for each image, in the same order."
        )
    largest = np.abs(L).max(1)
    bad = np.flatnonzero(~(np.isfinite(largest) & (largest > 0)))
    if bad.size:
        raise InputError(
            f"the light of {names[bad[0]]} is {L[bad[0]].tolist()} but a finite direction that is not zero is needed; "
            "correct it or leave that image out."
        )
    L = L / largest[:, None]  # so that no length overflows
    L = L / np.linalg.norm(L, axis=1, keepdims=True)
    s = np.linalg.svd(L, compute_uv=False)
    condition = float(s[0] / s[2]) if n >= 3 and s[2] > 0 else np.inf
    if condition > COPLANAR:
        raise InputError(
            f"the {n} lights lie in one plane (condition number {condition:.3g}, at most {COPLANAR:.0f} is usable); "
            "add lights from other sides."
        )
    return L


def from_the_middle(
    lamps: Lamps, camera: Camera | None, mask: Bool[np.ndarray, "h w"], names: Sequence[str]
) -> Float[np.ndarray, "n 3"]:
    """Vectors (n, 3) in mm from the object's middle to the lamps; InputError where they can't be such."""
    if len(lamps.positions_mm) != len(names):
        raise InputError(
            f"{len(lamps.positions_mm)} lamps came for {len(names)} images; give one position for each, in order."
        )
    if camera is None:
        raise InputError("lamps came without a camera but their millimetres need a scale; give --mm-per-px.")
    X = camera.flat_mm(mask)
    L = lamps.positions_mm - X.mean(0)
    r, radius = np.linalg.norm(L, axis=1), float(np.linalg.norm(X - X.mean(0), axis=1).max())
    nearest = int(r.argmin())
    if r[nearest] < max(radius, camera.mm_per_px):
        usual = float(np.median(r))
        factor = next((f for f in UNITS if usual < radius and 2 * radius < f * usual < FARTHEST * radius), None)
        raise InputError(
            f"the lamp of {names[nearest]} is {r[nearest]:.3g} mm from the middle of an object {2 * radius:.3g} mm "
            "wide, inside it, but lamps around it, in millimetres, are needed; "
            + (
                "correct it or the scale."
                if factor is None
                else f"multiply the positions by {factor}, since they look like {UNITS[factor]}."
            )
        )
    return L
