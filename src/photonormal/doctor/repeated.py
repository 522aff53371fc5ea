"""Pictures that show the same light though theirs are given far apart: a lamp that fired twice, or one that did not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from photonormal.doctor.finding import Finding
from photonormal.doctor.given import Given
from photonormal.doctor.misfit import MisfitPixels
from photonormal.geometry import angle_deg

APART_DEG = 10.0  # between given lights, below which pictures are alike anyway
TELLS = 0.03  # sine of the angle between two pictures from which on the object shows that two lights differ
ALIKE = 0.2  # and of it, as the given lights have it, that is left of pictures under one light: 0.5 of right ones
AS_ALIKE = 1.5  # times as unlike as the most alike ones
AS_SHADING = 0.5  # of what two pictures differ by, that another light explains, from which on theirs are two lights
MOST = 3  # pairs in a message


def repeated(given: Given, mask: Bool[np.ndarray, "h w"], names: Sequence[str]) -> list[Finding]:
    """Pictures that are equal up to a factor, where a matt surface under the given lights would make them differ."""
    L, pixels, raw = given.directions(), MisfitPixels.of(given.seen(), mask), MisfitPixels.of(given.levels, mask)
    if pixels is None or raw is None:
        return []
    shaded = (pixels.fit(L)[0] @ L.T).clip(0)  # (p, n)
    expected, shown = unlike(shaded, shaded), unlike(raw.I, raw.I)
    apart = angle_deg(L[:, None], L[None])
    nearest = np.where(np.eye(len(L), dtype=bool), np.inf, shown).min(0)  # (n,)
    same = (apart > APART_DEG) & (expected > TELLS) & (shown < ALIKE * expected)
    same &= shown <= AS_ALIKE * np.minimum(nearest, nearest[:, None])  # not those beside one of the two
    pairs = np.argwhere(np.triu(same, 1)).tolist()
    if pairs:  # lights that are near each other, and given badly, make pictures alike, too
        shape = raw.fit(L)[0]
        pairs = [(i, j) for i, j in pairs if as_shading(raw.I[:, i], raw.I[:, j], shape) < AS_SHADING]
    if not pairs:
        return []
    off = np.diag(unlike(pixels.I, shaded))  # of each picture, from what its own light makes
    pairs.sort(key=lambda pair: shown[tuple(pair)] / expected[tuple(pair)])
    said = [
        f"{names[i]} and {names[j]}, whose lights are {apart[i, j]:.0f} degrees apart "
        f"({names[i if off[i] > off[j] else j]} fits its own light worse)"
        for i, j in pairs
    ]
    more = f", and {len(said) - MOST} more pairs" if len(said) > MOST else ""
    message = (
        f"pictures show the same light, since they differ in brightness alone: {', '.join(said[:MOST])}{more}. A lamp "
        "fired twice, or did not fire; choose the other pictures with --images, or photograph these again."
    )
    return [Finding("repeated", True, message, {"pairs": [[names[i], names[j]] for i, j in pairs]})]


def as_shading(A: Float[np.ndarray, " p"], B: Float[np.ndarray, " p"], shape: Float[np.ndarray, "p 3"]) -> float:
    """Part of what two pictures differ by, but for a factor, that a turn of the light over a matt shape explains; of
    noise it explains next to nothing."""
    difference = A - (A @ B) / max(float(B @ B), 1e-12) * B
    turned = shape @ np.linalg.lstsq(shape, difference, rcond=None)[0]
    return float((turned**2).sum() / max(float((difference**2).sum()), 1e-12))


def unlike(A: Float[np.ndarray, "p n"], B: Float[np.ndarray, "p n"]) -> Float[np.ndarray, "n n"]:
    """Sines of the angles between pictures of A and of B: 0 where two are equal up to a factor."""
    A, B = (M / np.linalg.norm(M, axis=0).clip(1e-12) for M in (A, B))
    return np.sqrt((1 - (A.T @ B) ** 2).clip(0))
