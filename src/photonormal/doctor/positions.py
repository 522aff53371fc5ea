"""Lamps at places that can't be right, or that ask much of the solvers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from photonormal.doctor.finding import Finding, counted
from photonormal.doctor.given import Near, matt_misfit
from photonormal.types import a_few

CLOSE = 1.5  # widths of the object: nearer lamps leave much in shadow, and depth has to be known well
FAR = 100.0  # widths of the object: farther lamps are as good as distant
APART = 4.0  # factor between a lamp's distance and the usual one, above which it is a slip of the pen
FACTORS = (0.001, 0.01, 1 / 25.4, 0.1, 0.2, 0.4, 2.5, 5.0, 10.0)  # of all distances that are tried
BETTER = 0.5  # misfit at another factor, as part of the given one's, at which it is reported
PIXELS = 1500


def positions(given: Near, names: Sequence[str]) -> list[Finding]:
    """Lamps of another scale, too close or too far, away from the others, or turned away from the object."""
    width = 2 * float(np.linalg.norm(given.X - given.middle, axis=1).max())
    r = given.distances
    usual = float(np.median(r))
    ratio = f"{usual / width:.0f}" if usual > 10 * width else f"{usual / width:.1f}"
    where = f"{ratio} widths of the object away ({usual:.3g} mm, the object {width:.3g} mm)"
    numbers = {"object_mm": round(width, 4), "distance_mm": [round(float(v), 4) for v in r]}
    found = []

    def say(grave: bool, message: str) -> None:
        found.append(Finding("positions", grave, message, numbers))

    away = (given.lamps.axes * given.directions()).sum(1) >= 0
    dark = np.flatnonzero(away & (given.lamps.mu > 0)).tolist()
    if dark:
        say(
            True,
            f"{counted(len(dark), 'lamp shines', 'lamps shine')} away from the object "
            f"({a_few([names[j] for j in dark])}); turn their axes round: an axis points from the lamp to where it "
            "shines most.",
        )
    odd = np.flatnonzero(np.abs(np.log(r / usual)) > np.log(APART)).tolist()
    if odd:
        text = a_few([f"{names[j]} at {r[j]:.3g} mm" for j in odd])
        say(
            True,
            f"{counted(len(odd), 'lamp is', 'lamps are')} much nearer or farther than the others' {usual:.3g} mm "
            f"({text}); correct the positions.",
        )
    factor = None if dark else other_scale(given, width)
    if factor is not None:
        nearer = f"{1 / factor:.4g} times nearer" if factor < 1 else f"{factor:.3g} times farther"
        say(
            True,
            f"the lamps are {where}, but the pictures fit lamps about {nearer} much better; give positions and "
            "--mm-per-px in millimetres, not in metres, centimetres or inches.",
        )
    elif usual > FAR * width:
        say(
            False,
            f"the lamps are {where}, as good as distant; if they are nearer, give positions and --mm-per-px "
            "in millimetres.",
        )
    elif usual < CLOSE * width:
        say(
            False,
            f"the lamps are only {where}: errors of positions and depth count most there, and much lies in shadow; "
            "place the lamps 3 widths away or more.",
        )
    return found


def other_scale(given: Near, width: float) -> float | None:
    """The factor of all distances at which the pictures look matt, if they don't as given."""
    lit = np.flatnonzero(given.levels.max(1) > 0)
    some = lit[:: max(1, len(lit) // PIXELS)]
    few = replace(given, levels=given.levels[some], X=given.X[some])
    tried = [f for f in FACTORS if f * given.distances.min() > width / 2]  # outside the object
    misfits = [matt_misfit(few.scaled(f)) for f in tried]
    if not tried or min(misfits) > BETTER * matt_misfit(few):
        return None
    return tried[int(np.argmin(misfits))]
