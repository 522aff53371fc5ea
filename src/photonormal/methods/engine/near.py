"""Lamps near the object: any method, with normals and depth found in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float

from photonormal.integration import integrate
from photonormal.methods.contract import Solution
from photonormal.methods.engine import not_dark, on_mask
from photonormal.shading import FAINT, fall_off, towards
from photonormal.types import Camera, Capture, Image, InputError, Lamps, LightsAt, Normals


@dataclass(frozen=True)
class UnderLamps:
    """A method under near lamps, as exact as it is under distant ones where the integration recovers the surface.

    Where the surface lies shows how much light each lamp sends to each pixel, by which samples are divided, and from
    which side; the method's normals then show where the surface lies. A plane comes first. Each connected part of the
    mask stays at the mean depth, and how far the depth jumps is a guess. In a perspective view each pixel is solved in
    a frame whose z is its own view.

    Parameters
    ----------
    solve : gives what a method finds under lights that differ from pixel to pixel
    rounds : of normals, then depth, at most
    settled : root mean square of the surface's last move, relative to the lamps' mean distance, at which to stop
    """

    solve: Callable[[Capture], Solution]
    rounds: int = 10
    settled: float = 1e-4

    def __call__(self, capture: Capture) -> Solution:
        lamps, camera = near(capture)
        X = camera.flat_mm(capture.mask)
        still_mm = self.settled * mean_distance(lamps, X)
        found = self.at(capture, X)
        for _ in range(self.rounds - 1):
            before, X = X, surface_mm(capture, on_mask(not_dark(found, capture), capture))
            if np.sqrt(((X - before) ** 2).sum(-1).mean()) < still_mm:
                break
            found = self.at(capture, X)
        return found

    def at(self, capture: Capture, X: Float[np.ndarray, "p 3"]) -> Solution:
        """What the method finds if the surface were at `X`."""
        seen = without_fall_off(capture, X)
        _, camera = near(capture)
        if camera.K is None:
            return self.solve(seen)
        R = turns(-camera.rays(*capture.mask.shape)[capture.mask]).astype(np.float32)  # (p, 3, 3)
        assert seen.lights_at is not None
        found = self.solve(replace(seen, lights_at=TurnedLights(seen.lights_at, R)))
        return replace(found, normals=(found.normals[:, None] @ torch.from_numpy(R))[:, 0])


def near(capture: Capture) -> tuple[Lamps, Camera]:
    """The lamps and the camera that places them, or an error that says that they are missing."""
    if capture.lamps is None or capture.camera is None:
        raise InputError(
            f"{capture.name} has no positions of its lights but near lights need them; give light_positions.txt or "
            "--dome-radius-mm, and --mm-per-px."
        )
    return capture.lamps, capture.camera


def surface_mm(capture: Capture, normals: Normals) -> Float[np.ndarray, "p 3"]:
    """Where the mask's pixels lie, by the normals' integral, which may jump; at the mean depth where there is none."""
    _, camera = near(capture)
    return camera.points_mm(integrate(normals, "bilateral", K=camera.K).depth)[capture.mask]


def seen_as_distant(capture: Capture, normals: Normals) -> Capture:
    """The capture without the fall-off of near lamps on the surface of these normals; any other capture as it is."""
    return capture if capture.lamps is None else without_fall_off(capture, surface_mm(capture, normals))


def without_fall_off(capture: Capture, X: Float[np.ndarray, "p 3"]) -> Capture:
    """The capture as if every lamp sent the same light everywhere, for a surface whose pixels on the mask lie at `X`.

    Its `lights_at` are the directions from there.
    """
    lamps, camera = near(capture)
    arriving = Arriving(lamps, X, mean_distance(lamps, camera.flat_mm(capture.mask)))
    images = WithoutFallOff(capture, arriving)
    return replace(capture, images=images, lamps=None, lights_at=arriving, saturation=None)


def mean_distance(lamps: Lamps, X: Float[np.ndarray, "p 3"]) -> float:
    """Of all lamps from the middle of the points."""
    return float(np.linalg.norm(lamps.positions_mm - X.mean(0), axis=1).mean())


class Arriving:
    """What arrives from each lamp at the points `X` (p, 3): directions, and light that is 1 at distance `r0`."""

    def __init__(self, lamps: Lamps, X: Float[np.ndarray, "p 3"], r0: float):
        self.X, self.r0 = torch.from_numpy(X).float(), r0
        self.S, self.axes, self.mu = (
            torch.from_numpy(v).float() for v in (lamps.positions_mm, lamps.axes, lamps.mu)
        )  # (n, 3), (n, 3), (n,)

    def __getitem__(self, pixels: Any, /) -> Float[np.ndarray, "q n 3"]:
        """Unit vectors to all lamps from some of the points."""
        return towards(self.X[pixels], self.S)[0].numpy()

    def light(self, j: int, pixels: Any) -> Float[np.ndarray, " q"]:
        """What arrives from one lamp at some of the points."""
        one = slice(j, j + 1)
        L, r = towards(self.X[pixels], self.S[one])
        return (self.r0**2 * fall_off(L, r, self.axes[one], self.mu[one]))[:, 0].numpy()


@dataclass(frozen=True)
class TurnedLights:
    """Lights as some pixels see them, each in its own frame."""

    lights: LightsAt
    R: Float[np.ndarray, "p 3 3"]

    def __getitem__(self, pixels: Any, /) -> Float[np.ndarray, "q n 3"]:
        return self.lights[pixels] @ self.R[pixels].swapaxes(1, 2)


class WithoutFallOff:
    """Pictures divided by the light that arrives (`photonormal.types.Images`); zero where none does."""

    def __init__(self, capture: Capture, arriving: Arriving):
        self.capture, self.arriving, self.shape = capture, arriving, capture.images.shape
        mask = capture.mask
        self.number = np.cumsum(mask, dtype=np.int64).reshape(mask.shape) - 1  # of each pixel on the mask

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of one picture."""
        inside = self.capture.mask[rows, columns]
        part = self.capture.window(j, rows, columns)
        e = self.arriving.light(j, self.number[rows, columns][inside])
        found = np.zeros(part.shape, np.float32)
        found[inside] = part[inside] * np.where(e > FAINT, 1 / np.maximum(e, FAINT), 0)[:, None]
        return found

    def saturated(self, j: int, rows: slice, columns: slice) -> Bool[np.ndarray, "h w c"]:
        """Where the pictures were it before they were divided."""
        return self.capture.saturated(j, rows, columns, self.capture.window(j, rows, columns))

    def __getitem__(self, j: int, /) -> Image:
        return self.window(j, slice(None), slice(None))


def turns(v: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3 3"]:
    """Rotations that take vectors of the camera's side to z, by the shortest way."""
    x, y, z = np.moveaxis(v / np.linalg.norm(v, axis=-1, keepdims=True), -1, 0)
    a = 1 / (1 + z)
    rows = [[1 - a * x * x, -a * x * y, -x], [-a * x * y, 1 - a * y * y, -y], [x, y, z]]
    return np.moveaxis(np.array(rows), -1, 0)
