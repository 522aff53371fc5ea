"""Lights that disagree with the pictures: their order, their frame, their intensities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from photonormal.calibration.intensities import SHADOW, robust_normals, self_calibrated
from photonormal.doctor.finding import Finding, counted
from photonormal.doctor.frame import GIVEN, LambertianFit, Verdict, judged, wrong_frame
from photonormal.doctor.given import Given, Near
from photonormal.doctor.misfit import MATT, OF_PART, MisfitPixels
from photonormal.doctor.order import BETTER, Orders, order_name
from photonormal.geometry import angle_deg
from photonormal.types import a_few

OFF, FEW = 1.1, 0.25  # factor by which so many of the lights' intensities may be off before it is said
MANY_OFF = 1.25  # and those of more: bounced light brightens a whole ring of low lamps by a tenth
SPOILS = 3.0  # factor beyond which one light alone turns normals by degrees
SPREADS = 4.0  # and how many spreads of the other lights' factors
LESS_CURL = 0.8  # of what the given intensities make of the pictures, that others have
EXPLAINED = 0.4  # of the misfit is left at most with those factors
ANGLES_DEG = 6.0  # between a normal and the direction halfway to the light, by more of which orientations differ
ORIENTATIONS = 5  # of them at least: fewer may all shine
ELSEWHERE = 0.7  # of the logarithm of a factor at half of the samples, that is left at those farther from shine
SHINING = 0.85  # of the variance of factors that follows the lights' directions smoothly, as shine of what is flat does
DARK = 1e-3  # of the mean of all, the least that a picture counts
ORDERS = 12  # that are looked at closely
MORE_CURL = 1.1  # of what the given order makes of the pictures, that another may have
LIGHTS = 10  # of which it can be seen whether they are other pictures'
AS_CHANCE, WORSE, ROUGH = 0.6, 1.5, 0.5  # misfit, times what any three lights leave unexplained, and variance of the
# pictures' brightness that follows the lights' directions smoothly, at which they are


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
    given_as_is = lambertian_fit(given, mask)
    plain = judged(given_as_is)
    tried = [(order, judged(lambertian_fit(given.reordered(order), mask))) for order in better[:ORDERS]]
    tried = [(order, v) for order, v in tried if v.curl <= MORE_CURL * plain.curl]  # surfaces have the least of it
    if tried:
        return _reordered(given, names, orders, tried)
    if strangers := _of_other_pictures(given, mask, orders):
        return [strangers], given
    found = wrong_frame(given_as_is)
    if found is None:
        return [], given
    finding, M = found
    fixed = given.turned(M)
    return [replace(finding, lights=fixed.vectors if finding.numbers["half_turn_told"] else None)], fixed


def explained(given: Given) -> float:
    """Misfit of the lights as they are, 0 as low as three dimensions allow, 1 as bad as chance."""
    L = given.directions()
    return Orders.of(given.seen(), L).misfit(np.arange(len(L)))


def lambertian_fit(given: Given, mask: Bool[np.ndarray, "h w"]) -> LambertianFit:
    """What the lights make of the pictures, shadows and highlights left aside."""
    I, L = given.seen(), given.directions()
    return LambertianFit(I, robust_normals(I, L, I > SHADOW * np.quantile(I, 0.99)), mask, L)


def _reordered(
    given: Given, names: Sequence[str], orders: Orders, tried: list[tuple[Int[np.ndarray, " n"], Verdict]]
) -> tuple[list[Finding], Given]:
    """Of equally good orders the first that needs no other frame; else the first, with its frame corrected.

    Corrected lights are given where they are certain.
    """
    order, verdict = next((t for t in tried if t[1].frame == GIVEN), tried[0])
    also = "" if verdict.frame == GIVEN else f", and {verdict.name()}"
    before, after = orders.misfit(np.arange(len(names))), orders.misfit(order)
    right = given.reordered(order).turned(verdict.frame.matrix())
    sure = orders.sure(order) and (verdict.half or not also)
    if sure:
        todo = ", or use the corrected file that `photonormal check FOLDER --out report` writes"
    elif verdict.half or not also:
        todo = "; other orders fit nearly as well, so no corrected file is written"
    else:
        todo = "; the shading can't show half a turn, so no corrected file is written"
    finding = Finding(
        "order",
        True,
        f"the lights are not in the pictures' order: {order_name(order, names)} fits{also} (misfit {after:.2f} "
        f"instead of {before:.2f}; a random order has 1); put the lights' file in that order{todo}.",
        {"misfit": round(before, 3), "misfit_best": round(after, 3), "order": order_name(order, names)},
        lights=right.vectors if sure else None,
    )
    return [finding], right


def _of_other_pictures(given: Given, mask: Bool[np.ndarray, "h w"], orders: Orders) -> Finding | None:
    """Lights that explain the pictures hardly better than in a random order, where others would explain them better.

    Under its own lights an object is bright or dark by where each stands, however it shines; under others it is not.
    """
    L = given.directions()
    pixels, misfit = MisfitPixels.of(given.seen(), mask), orders.misfit(np.arange(len(L)))
    if pixels is None or len(L) < LIGHTS or misfit < AS_CHANCE:
        return None
    left, least = (float(np.median(pixels.fit(lights)[1])) for lights in (L, orders.principal()))
    brightness = np.median(pixels.I / pixels.I.mean(1, keepdims=True), axis=0)
    if left < WORSE * least or smooth(np.log(brightness.clip(DARK)), L) > ROUGH:
        return None
    message = (
        f"the lights don't belong to these pictures: other lights would explain them {left / least:.1f} times better. "
        "The file is another dome's or another day's, or its order could not be found; give the file that was made for "
        "this capture, with the lights in the pictures' order."
    )
    return Finding("order", True, message, {"misfit": round(misfit, 3), "times": round(left / least, 1)})


def intensities(given: Given, mask: Bool[np.ndarray, "h w"], names: Sequence[str]) -> list[Finding]:
    """Lights brighter or darker than given, by the object's own shading, where that explains it in all parts.

    Shine brightens a picture where normals are halfway to its light, an intensity wherever they point. Shine of what
    is flat brightens pictures by where their lights stand.
    """
    pixels, L = MisfitPixels.of(given.seen(), mask), given.directions()
    if pixels is None:
        return []
    e, _ = self_calibrated(pixels.I, L)
    factor = e / np.median(e)
    evened = pixels.showing(pixels.I / factor)
    after = evened.fit(L)[1]
    if np.median(after) > MATT:
        return []
    numbers = {"factors": [round(float(f), 4) for f in factor]}

    def confirmed(j: int) -> bool:
        others = replace(evened, lit=evened.lit & (np.arange(len(L)) != j))
        b = others.fit(L)[0]
        shown, lit = (b @ L[j]).clip(0), pixels.lit[:, j] & (b @ L[j] > 0)
        before, after = (np.abs(p.I[:, j] - shown) / pixels.level for p in (pixels, evened))
        after *= min(factor[j], 1)  # as they are in the darker of both
        angle = angle_deg(b, np.broadcast_to(L[j] + [0, 0, 1], b.shape))
        part = (angle // ANGLES_DEG).astype(int)
        if (np.bincount(part[lit]) >= OF_PART).sum() < ORIENTATIONS:
            return False
        change = np.log(pixels.I[:, j].clip(1e-6) / shown.clip(1e-6))
        far = angle > np.median(angle[lit])
        if abs(np.median(change[lit & far])) < ELSEWHERE * abs(np.median(change[lit & ~far])):
            return False
        oriented = replace(pixels, part=part)
        return all(p.gain(before, after, lit).below(EXPLAINED) for p in (pixels, oriented))

    spread = 1.4826 * float(np.median(np.abs(np.log(factor))))
    if spread > np.log(MANY_OFF):
        if smooth(np.log(factor), L) > SHINING:
            return []
        before, even = lambertian_fit(given, mask), lambertian_fit(given.showing(given.levels / factor), mask)
        smoother = judged(even).curl < LESS_CURL * judged(before).curl
        if not (smoother and pixels.gain(pixels.fit(L)[1], after).below(EXPLAINED)):
            return []
        off = np.flatnonzero(np.abs(np.log(factor)) > np.log(MANY_OFF)).tolist()
        if 2 * sum(map(confirmed, off)) < len(off):
            return []
        message = (
            f"the lights' intensities differ from those given by {100 * (np.exp(spread) - 1):.0f} % as a rule; "
            "find the right ones with `photonormal intensities FOLDER --out FOLDER/light_intensities.txt`, or add "
            "--exif-exposure if the camera's exposure changed."
        )
        return [Finding("intensities", True, message, numbers)]

    by = np.abs(np.log(factor))
    off = np.flatnonzero(by > max(np.log(OFF), SPREADS * spread))
    if len(off) > FEW * len(L):
        off = np.flatnonzero(by > max(np.log(MANY_OFF), SPREADS * spread))
    off = np.array([j for j in off if confirmed(int(j))], int)
    if not off.size:
        return []
    worst = off[np.argsort(-np.abs(np.log(factor[off])))]
    text = a_few([f"{names[j]} x {factor[j]:.2f}" for j in worst])
    message = (
        f"{counted(len(off), 'light is', 'lights are')} brighter or darker than given ({text}); correct "
        "light_intensities.txt, or choose the other pictures with --images. If the camera's exposure changed, add "
        "--exif-exposure."
    )
    if factor[off].min() < 1 / SPOILS:
        message += " A picture that is far darker shows other light, with its lamp off."
    return [Finding("intensities", bool(np.abs(np.log(factor[off])).max() > np.log(SPOILS)), message, numbers)]


def smooth(v: Float[np.ndarray, " n"], L: Float[np.ndarray, "n 3"]) -> float:
    """Part of the variance of v that a quadratic polynomial in the lights' x and y shows, beyond what chance does."""
    x, y = L[:, 0], L[:, 1]
    A = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    left = ((v - A @ np.linalg.lstsq(A, v, rcond=None)[0]) ** 2).sum() / max(len(v) - A.shape[1], 1)
    return 1 - float(left / v.var(ddof=1)) if v.var() else 0.0
