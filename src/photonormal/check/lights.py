"""Lights that disagree with the pictures: their order, their frame, their intensities, and light that stays on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibrate.intensities import SHADOW, robust_normals, self_calibrated
from photonormal.check.finding import Finding, listed
from photonormal.check.frame import GIVEN, Surface, judged, wrong_frame
from photonormal.check.given import Given, Near
from photonormal.check.order import BETTER, Orders, name_of

PIXELS = 1200  # that intensities and ambient light are estimated from
OFF = 1.25  # factor by which a light's intensity may be off before it is said
SPREADS = 4.0  # and how many spreads of the other lights' factors
AMBIENT = 0.06  # brightness in attached shadow, as part of a pixel facing its light, above which it is said
FACING_AWAY = -0.15  # n.l of what lies in attached shadow for certain
LEAST = 100  # samples in attached shadow at least


def disagreement(given: Given, mask: Bool[np.ndarray, "h w"], names: Sequence[str]) -> tuple[list[Finding], Given]:
    """The order or the frame of the lights, where another one fits the pictures; both where both are wrong.

    Also the lights that do fit. Orders of near lamps are looked for among directions alone, and have to explain the
    pictures from where the lamps are, too.
    """
    orders = Orders.of(given.levels, given.directions())
    better = orders.better(names)
    if isinstance(given, Near) and better:
        limit = BETTER * explained(given)
        better = [order for order in better if explained(given.reordered(order)) < limit]
    if better:
        return _reordered(given, mask, names, orders, better)
    found = wrong_frame(surface_of(given, mask))
    if found is None:
        return [], given
    finding, M = found
    fixed = given.turned(M)
    return [replace(finding, lights=fixed.vectors if finding.numbers["half_turn_told"] else None)], fixed


def explained(given: Given) -> float:
    """Misfit of the lights as they are, 0 as low as three dimensions allow, 1 as bad as chance."""
    L = given.directions()
    return Orders.of(given.seen(), L).misfit(np.arange(len(L)))


def surface_of(given: Given, mask: Bool[np.ndarray, "h w"]) -> Surface:
    """What the lights make of the pictures, shadows and highlights left aside."""
    I, L = given.seen(), given.directions()
    return Surface(I, robust_normals(I, L, I > SHADOW * np.quantile(I, 0.99)), mask, L)


def _reordered(
    given: Given, mask: np.ndarray, names: Sequence[str], orders: Orders, better: list[np.ndarray]
) -> tuple[list[Finding], Given]:
    """Of equally good orders the first that needs no other frame; else the first, with its frame corrected."""
    fixed = [given.reordered(order) for order in better]
    verdicts = [judged(surface_of(f, mask)) for f in fixed]
    k = next((k for k, v in enumerate(verdicts) if v.frame == GIVEN), 0)
    also = "" if verdicts[k].frame == GIVEN else f", and {verdicts[k].name()}"
    before, after = orders.misfit(np.arange(len(names))), orders.misfit(better[k])
    right = fixed[k].turned(verdicts[k].frame.matrix())
    finding = Finding(
        "order",
        True,
        f"the lights are not in the pictures' order: {name_of(better[k], names)} fits{also} (misfit {after:.2f} "
        f"instead of {before:.2f}, 1 is chance); put the lights' file in that order, or use the corrected one.",
        {"misfit": round(before, 3), "misfit_best": round(after, 3), "order": name_of(better[k], names)},
        lights=right.vectors if verdicts[k].half or not also else None,
    )
    return [finding], right


def intensities(I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"], names: Sequence[str]) -> list[Finding]:
    """Lights brighter or darker than given, by the object's own shading."""
    J = I[_spread(len(I), PIXELS)]
    e, _ = self_calibrated(J[J.max(1) > 0], L)
    factor = e / np.median(e)
    spread = 1.4826 * float(np.median(np.abs(np.log(factor))))
    off = np.flatnonzero(np.abs(np.log(factor)) > max(np.log(OFF), SPREADS * spread))
    if spread > np.log(OFF):
        return [
            Finding(
                "intensities",
                True,
                f"the lights' intensities differ from those given by {100 * (np.exp(spread) - 1):.0f} % as a rule; "
                "give light_intensities.txt, or calibrate them.",
                {"factors": [round(float(f), 4) for f in factor]},
            )
        ]
    if not off.size:
        return []
    worst = off[np.argsort(-np.abs(np.log(factor[off])))]
    text = listed([f"{names[j]} x {factor[j]:.2f}" for j in worst])
    return [
        Finding(
            "intensities",
            False,
            f"{len(off)} lights are brighter or darker than given ({text}); correct light_intensities.txt or the "
            "exposure, or leave those pictures out.",
            {"factors": [round(float(f), 4) for f in factor]},
        )
    ]


def ambient(I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"]) -> list[Finding]:
    """Light that stays on: what faces away from a light is not black."""
    J = I[_spread(len(I), PIXELS)]
    J = J[J.max(1) > 0]
    b = robust_normals(J, L, J > SHADOW * np.quantile(J, 0.99))
    size = np.linalg.norm(b, axis=1, keepdims=True).clip(1e-12)
    shadow = (b / size) @ L.T < FACING_AWAY
    if shadow.sum() < LEAST:
        return []
    level = float(np.median((J / size)[shadow]))
    if level < AMBIENT:
        return []
    return [
        Finding(
            "ambient",
            level > 2 * AMBIENT,
            f"what faces away from its light still shows {100 * level:.0f} % of full brightness: other light is on, or "
            "black is not at zero; darken the room, or subtract a picture taken with all lights off.",
            {"shadow_level": round(level, 4)},
        )
    ]


def _spread(p: int, count: int) -> slice:
    return slice(None, None, max(1, p // count))
