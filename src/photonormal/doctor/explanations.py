"""What else may be wrong with pictures that their lights explain badly: each explanation is tried, the best reported.

Other light that stays on, pictures that are not linear, lamps that are near, directions halfway to the right ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from photonormal.calibration.intensities import self_calibrated
from photonormal.doctor.finding import Finding
from photonormal.doctor.given import Given, Near
from photonormal.doctor.misfit import MATT, MisfitPixels
from photonormal.geometry import normalised
from photonormal.srgb import from_linear, to_linear

WIDTHS = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0)  # of the object, from its middle: distances of lamps that are tried
NEAR, MIRRORED = 0.89, 0.8  # misfit with near lamps, as part of that with distant ones, and with a mirrored plane
SHINES = 0.3  # of each pixel's lit samples, the brightest, that may shine and hide near lamps
BY_NORMALS = 0.965, 0.93  # misfit with near lamps, as part of that with normals for places; and without what shines
HALFWAY, PARTS_AGREE = 0.3, 5.0  # misfit with twice the zenith angles, and standard errors by which parts agree
LESS, MORE = 1.7, 2.3  # times the zenith angles: what fits no worse with one of them was no doubling
BY_FACTORS = 1.05  # misfit with twice the angles, as part of that with a factor for each light
CORRECTED = 0.25  # misfit with twice the angles below which they are written
OFFSET, ENCODED = 0.7, 0.7  # misfit with light that stays on, and of linearised samples
WELL = 0.2  # what light that stays on may leave where pictures are likely encoded
EXPLAINED = 0.12  # misfit that light which stays on may leave: else neither explains the pictures
AS_MATT, PLAINLY = 0.008, 0.4  # misfit that no material keeps below, and what is left of it where light stays on
AGAIN, TAKEN = 0.45, -0.12  # misfit with the curve taken back, and what it took away, as part of full brightness
ON, OF_PIXELS = 0.1, 0.6  # that light, as part of full brightness, and the pixels that show most of it
MOST = 0.06  # of it
PROPHOTO, CLEARER = 1.8, 0.6  # exponent, and misfit with it, as part of that with sRGB's curve
STEEPER = 2.2  # relative errors grow so much where samples are linearised
BEHIND = -0.1  # z of a light below which it can't have lit the object
FAINT = 0.05  # of the brightest pixels' level, below which a pixel shows nothing
SAME = 0.05  # deviation of a pixel's samples, as part of their mean, that nine tenths of the pixels stay below
RING, NEVER_DARK = 0.003, 0.25  # of the largest singular value; and of a pixel's mean
DROWNED = 3.0  # light that stays on, as part of full brightness, in which the lamps' is lost
GRAVE = 0.12  # light that stays on, above which it spoils the normals


def explanation(
    given: Given, mask: Bool[np.ndarray, "h w"], bits: int | None, linearised: bool, encoded: bool = False
) -> list[Finding]:
    """The explanation that leaves least of the misfit; none where none leaves clearly less in all of the object.

    `bits` of the samples, None for floats; `linearised` where they were encoded, by their files' word or the user's;
    `encoded` where they were taken for linear but seldom are.
    """
    L = given.directions()
    pixels = MisfitPixels.of(given.seen(), mask)
    if pixels is None:
        return _hardly_differ(given.levels, L)
    fitted = _, before = pixels.fit(L)
    tried = [_staying_on(pixels, L, before, None if linearised else bits, encoded)]
    if linearised:
        tried.append(_linear_before(pixels, L, before))
    if not isinstance(given, Near):
        dull = pixels.duller(SHINES)
        near = _near(pixels, L, fitted, BY_NORMALS[0]) or _near(dull, L, dull.fit(L), BY_NORMALS[1])
        tried += [near, _halfway(pixels, L, before)]
    found = [t for t in tried if t is not None]
    return [min(found, key=lambda t: t[0])[1]] if found else _hardly_differ(given.levels, L)


def _hardly_differ(I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"]) -> list[Finding]:
    """Pictures that are nearly the same, and lights on one ring, under which c of I = b.l + c can't be found."""
    level = I.mean(1)
    J = I[level > FAINT * np.quantile(level, 0.95)]
    level = J.mean(1).clip(1e-12)
    darkest = float(np.quantile(J.min(1) / level, 0.01))
    differ = float(np.quantile(J.std(1) / level, 0.9))
    s = np.linalg.svd(np.concatenate([L, np.ones((len(L), 1))], axis=1), compute_uv=False)
    ring = len(L) == 3 or s[3] < RING * s[0]
    if differ > SAME and not (ring and darkest > NEVER_DARK):
        return []
    message = (
        f"the pictures hardly differ: no part of the object falls below {100 * darkest:.0f} % of its mean in any of "
        "them. If other light was on, give a picture taken with all lamps off as --dark; the check can't find that "
        "light under lamps on one ring. Otherwise place the lamps lower."
    )
    return [Finding("contrast", differ < SAME, message, {"differ": round(differ, 4), "darkest": round(darkest, 4)})]


def _staying_on(
    pixels: MisfitPixels, L: np.ndarray, before: np.ndarray, bits: int | None, encoded: bool
) -> tuple[float, Finding] | None:
    """I = b.l + c with c above zero in most pixels: other light, or a picture whose encoding lifts the dark.

    Where pictures are likely `encoded`, other light has to explain them well, or be there once they are linearised.
    """
    b, after = pixels.fit(np.concatenate([L, np.ones((len(L), 1))], axis=1))
    size = np.linalg.norm(b[:, :3], axis=1).clip(1e-9)
    lifted, on = b[:, 3] / size, np.minimum(b[:, 3], pixels.I.min(1)) / size  # what stays on is on in shadows, too
    offset = pixels.gain(before, after)
    plain = np.median(before) > AS_MATT or offset.left < PLAINLY
    ambient = _common(on) and offset.below(OFFSET) and plain and np.median(after) < EXPLAINED
    if bits is not None and _common(lifted):
        curved, pro = (pixels.gain(before, pixels.showing(f(pixels.I)).fit(L)[1]) for f in (to_linear, _of_prophoto))
        linear = pro if pro.left < CLEARER * curved.left else curved
        if linear.below(ENCODED) and not (ambient and linear.left > STEEPER * offset.left):
            better = f"linearised, they fit a matt surface {1 / max(linear.left, 0.01):.1f} times better"
            message = f"the pictures look sRGB-encoded: {better}; add --srgb, or export linear pictures."
            options = {"srgb": True, "linear": False}
            if linear is pro:
                message = (
                    f"the pictures look encoded with a gamma of {PROPHOTO}, as in ProPhoto RGB: {better}. Export them "
                    "with their colour profile, or export linear pictures."
                )
                options = {}
            numbers = {"misfit_linearised": round(linear.left, 4)}
            return linear.left / STEEPER, Finding("encoding", True, message, numbers, options=options)
    if not ambient:
        return None
    if encoded and offset.left > WELL:
        linear = pixels.showing(to_linear(pixels.I))
        if _staying_on(linear, L, linear.fit(L)[1], None, False) is None:
            message = (
                "the pictures look sRGB-encoded, as most JPEG files are: as stored, they seem to show light that stays "
                "on, and linearised they don't; add --srgb."
            )
            numbers = {"misfit_left": round(offset.left, 4)}
            return offset.left, Finding("encoding", True, message, numbers, options={"srgb": True, "linear": False})
    level = float(np.median(on))
    there = f"{100 * level:.0f} % of full brightness stays, whichever lamp is lit"
    if level > DROWNED:
        there = f"the pictures hardly differ, since it is {level:.0f} times as bright as the lamps"
    message = (
        f"ambient light: {there}. Darken the room, or give a picture taken with all lamps off as --dark. If the "
        "pictures are sRGB-encoded, add --srgb first."
    )
    numbers = {"ambient_level": round(level, 4), "misfit_left": round(offset.left, 4)}
    return offset.left, Finding("ambient", level > GRAVE, message, numbers)


def _of_prophoto(I: np.ndarray) -> np.ndarray:
    return I.clip(0) ** PROPHOTO


def _common(on: Float[np.ndarray, " p"]) -> bool:
    """Whether light that stays on, as part of full brightness, is there in most pixels."""
    return bool(np.median(on) > ON and (on > MOST).mean() > OF_PIXELS)


def _linear_before(pixels: MisfitPixels, L: np.ndarray, before: np.ndarray) -> tuple[float, Finding] | None:
    """I = b.l + c with c below zero in most pixels, and none with the curve that was applied taken back."""
    b = pixels.fit(np.concatenate([L, np.ones((len(L), 1))], axis=1))[0]
    if np.median(b[:, 3] / np.linalg.norm(b[:, :3], axis=1).clip(1e-9)) > TAKEN:
        return None
    gain = pixels.gain(before, pixels.showing(from_linear(pixels.I.clip(0, 1))).fit(L)[1])
    if not gain.below(AGAIN):
        return None
    message = (
        "the pictures were linearised, but fit a matt surface "
        f"{1 / max(gain.left, 0.01):.1f} times better as their files store them, so they look linear. Leave --srgb "
        "out, or add --linear."
    )
    numbers, options = {"misfit_as_stored": round(gain.left, 4)}, {"srgb": False, "linear": True}
    return gain.left, Finding("encoding", True, message, numbers, options=options)


def _near(
    pixels: MisfitPixels, L: np.ndarray, fitted: tuple[np.ndarray, np.ndarray], part: float
) -> tuple[float, Finding] | None:
    """Each picture is brighter on its lamp's side, as on a plane under lamps at one distance.

    On what is round or domed normals face the lamp on that side, too, and sheen is brighter there: places have to
    explain more than normals do, and leave at most this part of what those leave.
    """
    b, before = fitted  # under distant lights
    gains = [pixels.gain(before, pixels.fit(at_distance(pixels.place, L, d))[1]) for d in WIDTHS]
    k = int(np.argmin([g.left for g in gains]))
    if not gains[k].below(NEAR):
        return None
    mirrored = pixels.gain(before, pixels.fit(at_distance(-pixels.place, L, WIDTHS[k]))[1])
    if gains[k].left > MIRRORED * mirrored.left:
        return None
    place = normalised(b)[:, :2]
    place = place - place.mean(0)
    place *= np.linalg.norm(pixels.place) / np.linalg.norm(place).clip(1e-9)  # as those of a dome are
    by_normals = min(pixels.gain(before, pixels.fit(at_distance(place, L, d))[1]).left for d in WIDTHS)
    if gains[k].left > part * by_normals:
        return None
    message = (
        "the lamps are near: each picture is brighter on its lamp's side, as if they were about "
        f"{WIDTHS[k]:g} widths of the object away, but only directions are given. Give --mm-per-px with "
        "--dome-radius-mm or with positions in mm, or a picture of a white board for each light with --flat FOLDER."
    )
    numbers: dict[str, Any] = {"distance_widths": WIDTHS[k], "misfit_left": round(gains[k].left, 4)}
    return gains[k].left, Finding("near", True, message, numbers)


def at_distance(
    place: Float[np.ndarray, "p 2"], L: Float[np.ndarray, "n 3"], widths: float
) -> Float[np.ndarray, "p n 3"]:
    """Lights (p, n, 3) of each pixel, longer where more arrives, for lamps so far from a plane's middle."""
    d = widths * L - np.concatenate([place, np.zeros((len(place), 1))], axis=1)[:, None]
    return widths**2 * d / np.linalg.norm(d, axis=-1, keepdims=True) ** 3


def _halfway(pixels: MisfitPixels, L: np.ndarray, before: np.ndarray) -> tuple[float, Finding] | None:
    """Directions are the normals of a mirror sphere where it shows the lamps: twice the angle to the axis fits best.

    A flat thing that shines does as if each light had an intensity of its own, which must not explain more. The
    corrected ones are given where little of the misfit is left.
    """
    reflected = raised(L, 2.0)
    if reflected[:, 2].min() < BEHIND:
        return None
    after = pixels.fit(reflected)[1]
    gain = pixels.gain(before, after)
    if not gain.below(HALFWAY, PARTS_AGREE) or np.median(after) > MATT:
        return None
    others = [pixels.gain(pixels.fit(raised(L, factor))[1], after) for factor in (LESS, MORE)]
    if any(other.left > 1 for other in others):
        return None
    e, _ = self_calibrated(pixels.I, L)  # as a flat thing shines under each light
    if pixels.gain(pixels.showing(pixels.I / e).fit(L)[1], after).left > BY_FACTORS:
        return None
    message = (
        "the lights' directions are halfway to the right ones: with twice their angles to the camera's axis they fit "
        f"{1 / max(gain.left, 0.01):.1f} times better. They look like the normals n of a mirror sphere at its "
        "highlights. Give the reflections there instead, 2 (n.v) n - v, where v points to the camera."
    )
    numbers = {"misfit_left": round(gain.left, 4)}
    return gain.left, Finding("halfway", True, message, numbers, lights=reflected if gain.left < CORRECTED else None)


def raised(L: Float[np.ndarray, "n 3"], factor: float) -> Float[np.ndarray, "n 3"]:
    """Directions at so many times their angle to the view axis."""
    zenith, azimuth = factor * np.arccos(L[:, 2].clip(-1, 1)), np.arctan2(L[:, 1], L[:, 0])
    return np.stack([np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)], axis=-1)
