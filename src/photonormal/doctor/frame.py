"""Lights given in another frame: an axis flipped, x and y exchanged, turned about the view.

Turning or mirroring all lights does the same to the normals and leaves every picture explained as well as before. Three
things show: slopes have to be a surface's (`curl`), which half a turn keeps; normals at an occluding outline point
outwards (`outline`); shadows fall away from what casts them (`shadows`). Nothing shows half a turn
of a flat relief without shadows: turned inside out it looks the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from photonormal.curl import Curl
from photonormal.doctor.finding import Finding
from photonormal.doctor.shadows import CastShadows
from photonormal.geometry import FRAMES, from_frame
from photonormal.outline import Outline

SNAP_DEG, AS_GOOD = 20, 1.05  # a turn is a multiple of 45 degrees where one so near has a curl as low, up to a factor
STEP_DEG, SMALL_DEG = 5, 15  # of the turns tried; those below the second are no mistake of a frame
WORSE = 1.25  # curl of the given frame over another one's, at which that is reported
CERTAIN = 3.0  # and its mean over parts of the surface, in standard errors
MIRRORED = {
    0: "y is flipped (y counts downwards)",
    -180: "x is flipped",
    90: "x and y are exchanged",
    -90: "x and y are exchanged and both flipped",
}


@dataclass(frozen=True)
class NormalsFrame:
    """Normals as they would be: y flipped if `mirrored`, then turned by `turn_deg` counter-clockwise."""

    mirrored: bool
    turn_deg: int

    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """(3, 3), to be applied to columns."""
        c, s = np.cos(np.radians(self.turn_deg)), np.sin(np.radians(self.turn_deg))
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([1.0, -1.0 if self.mirrored else 1.0, 1.0])

    def half_turned(self) -> NormalsFrame:
        """Half a turn on."""
        return NormalsFrame(self.mirrored, (self.turn_deg + 180) % 360)

    def name(self) -> str:
        """What was done to the lights."""
        turn = (self.turn_deg + 180) % 360 - 180
        if self.mirrored:
            return MIRRORED.get(turn, f"y is flipped and the lights are turned by {-turn} degrees")
        return "x and y are both flipped" if turn == -180 else f"the lights are turned by {-turn} degrees"


GIVEN = NormalsFrame(False, 0)
TRIED = [NormalsFrame(True, deg) for deg in range(0, 180, STEP_DEG)]  # half turns aside, which change no curl
TRIED += [NormalsFrame(False, deg) for deg in range(SMALL_DEG, 181 - SMALL_DEG, STEP_DEG)]
SMALL = [NormalsFrame(False, deg) for deg in range(STEP_DEG - SMALL_DEG, SMALL_DEG, STEP_DEG)]  # what inexact lights do
QUARTERS = [NormalsFrame(mirrored, deg) for mirrored in (False, True) for deg in (0, 90, 180, 270)]


@dataclass(frozen=True)
class LambertianFit:
    """What lights as given make of the pictures, on a grid of pixels.

    Parameters
    ----------
    I : (p, n) grey levels of the mask's pixels
    b : (p, 3) scaled normals that explain their lit samples
    mask : (h, w)
    L : (n, 3)
    """

    I: Float[np.ndarray, "p n"]
    b: Float[np.ndarray, "p 3"]
    mask: Bool[np.ndarray, "h w"]
    L: Float[np.ndarray, "n 3"]

    def with_z_turned(self) -> LambertianFit:
        """As if z of all lights had the other sign."""
        z = np.array([1.0, 1.0, -1.0])
        return LambertianFit(self.I, self.b * z, self.mask, self.L * z)

    @cached_property
    def normals(self) -> Float[np.ndarray, "h w 3"]:
        """Unit on the mask, zero outside."""
        N = np.zeros((*self.mask.shape, 3))
        N[self.mask] = self.b / np.linalg.norm(self.b, axis=1, keepdims=True).clip(1e-12)
        return N

    @cached_property
    def outline(self) -> Outline | None:
        return Outline.of(self.normals, self.mask)

    @cached_property
    def shadows(self) -> CastShadows:
        return CastShadows.of(self.I, self.b, self.mask, self.L)


@dataclass(frozen=True)
class Verdict:
    """The frame that the pictures speak for, `GIVEN` where for none; `half`: whether it decides half a turn."""

    frame: NormalsFrame
    half: bool
    numbers: dict[str, Any]

    @property
    def curl(self) -> float:
        """The least curl of all frames; 0 where too few slopes are known."""
        return self.numbers.get("curl_best", 0.0)

    def name(self) -> str:
        """What was done to the lights, as far as is known."""
        other = "" if self.half else f", or {self.frame.half_turned().name()}"
        return self.frame.name() + other


def judged(fit: LambertianFit) -> Verdict:
    """The frame of the lights that makes a surface of what they show."""
    frame, numbers = _up_to_half_a_turn(fit)
    half = _half_turned(fit, frame, numbers)
    if half is None:
        return Verdict(frame, False, numbers)
    return Verdict(frame.half_turned() if half else frame, True, numbers)


def _up_to_half_a_turn(fit: LambertianFit) -> tuple[NormalsFrame, dict[str, Any]]:
    curl = Curl.of(fit.normals, fit.mask)
    if curl is None:
        return GIVEN, {}
    best = min(TRIED, key=curl.total)
    usual = NormalsFrame(best.mirrored, round(best.turn_deg / 45) * 45 % 180)
    if curl.total(usual) <= AS_GOOD * curl.total(best) and usual != GIVEN:
        best = usual
    # Parallel folds mirrored about their own direction look as they did, so lights that are a little off fit a mirrored
    # frame better than the given one, but not better than one turned a little. Shine turns slopes a little, too.
    meant = min(SMALL, key=curl.total)
    given, least = curl.total(meant), curl.total(best)
    numbers = {"curl": round(curl.total(GIVEN), 4), "curl_best": round(min(given, least), 4)}
    if given > WORSE * least and curl.certainty(meant, best) > CERTAIN:
        return best, numbers
    return GIVEN, numbers


def _half_turned(fit: LambertianFit, frame: NormalsFrame, numbers: dict[str, Any]) -> bool | None:
    """Whether half a turn is missing; None where neither shadows nor an outline show, or they disagree.

    Where each by itself says too little, both together may show.
    """
    M, outline = frame.matrix(), fit.outline
    votes = [fit.shadows.vote(M), 0.0 if outline is None else outline.vote(M)]
    if not any(votes) and outline is not None:
        votes = [fit.shadows.leaning(M), outline.leaning(M)]
        votes = votes if all(votes) else [0.0, 0.0]
    signs = {v > 0 for v in votes if v}
    numbers |= {"half_turn": [round(v, 3) for v in votes]}
    return signs.pop() is False if len(signs) == 1 else None


def wrong_frame(fit: LambertianFit) -> tuple[Finding, Float[np.ndarray, "3 3"]] | None:
    """The lights' frame, if what they show is no surface, and what corrects them.

    Up to half a turn, where the finding's numbers say that it is not decided.
    """
    below = np.median(fit.L[:, 2]) < 0  # lights in front don't show a surface that faces away
    away = bool(below and (fit.normals[fit.mask][:, 2] < 0).mean() > 0.5)
    verdict = judged(fit.with_z_turned() if away else fit)
    if verdict.frame == GIVEN and not away:
        return None
    M = verdict.frame.matrix() @ np.diag([1.0, 1.0, -1.0 if away else 1.0])
    what = [verdict.name()] if verdict.frame != GIVEN else []
    if away:
        what = ["z of the lights is flipped (the normals point away from the camera)", *what]
    numbers = verdict.numbers | {"frame": ", and ".join(what), "half_turn_told": verdict.half}
    known = next((name for name in FRAMES if np.allclose(from_frame(np.eye(3), name), M)), None)
    other = f"where no --frame was given, add --frame {known}" if verdict.half and known else "give another --frame"
    todo = (
        f"x has to point right, y up and z to the camera; correct the lights' file or the ring's --start, or {other}."
    )
    if not verdict.half:
        todo += (
            " x and y may have to change sign as well: a flat relief looks the same inside out, so the shading doesn't "
            "show it, and no corrected lights are written. Try both."
        )
    message = f"the lights' frame disagrees with the pictures: {numbers['frame']}; {todo}"
    return Finding("frame", True, message, numbers), M
