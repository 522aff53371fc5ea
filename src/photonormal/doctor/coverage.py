"""How well the lights cover the hemisphere, and a plot of them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from photonormal.doctor.finding import Finding, counted
from photonormal.types import lights_behind

FEW = 6  # lights: fewer leave no sample to spare for a shadow or a highlight
NARROW_DEG = 25.0  # from the axis: lights nearer than that show little of steep parts
GAP_DEG = 120.0  # around the axis without a light
TILTED_DEG = 15.0  # from the axis: lights nearer than that have no side
UNEVEN = 12.0  # condition number of the lights
LINE = 3.0  # their middle singular value over the smallest, from which on those on two sides lie about in one line
SIZE = 640  # pixels of the plot


def coverage(L: Float[np.ndarray, "n 3"]) -> list[Finding]:
    """Few, narrow, one-sided or ill-conditioned lights."""
    zenith = np.degrees(np.arccos(L[:, 2].clip(-1, 1)))
    azimuth = np.degrees(np.arctan2(L[:, 1], L[:, 0]))[zenith > TILTED_DEG]
    _, s, V = np.linalg.svd(L)
    numbers = {
        "lights": len(L),
        "widest_deg": round(float(zenith.max()), 1),
        "condition": round(float(s[0] / max(s[2], 1e-6)), 2),
    }
    found = []
    if len(L) < FEW:
        found.append(f"{len(L)} lights leave no sample to spare for shadows and highlights; use 10 lights or more")
    if zenith.max() < NARROW_DEG:
        found.append(
            f"all lights are within {zenith.max():.0f} degrees of the camera's axis, so normals of steep parts will be "
            "uncertain; place some lights 40 to 60 degrees off that axis"
        )
    elif azimuth.size:
        around = np.sort(azimuth)
        gaps = np.diff(np.append(around, around[0] + 360))
        k = int(gaps.argmax())
        numbers["gap_deg"] = round(float(gaps[k]), 1)
        if np.sum(gaps > GAP_DEG) == 2 and s[1] > LINE * s[2]:
            across = np.degrees(np.arctan2(V[2, 1], V[2, 0])) % 180
            sides = f"the {_side(across)} and the {_side(across + 180)}"
            found.append(
                f"the lights lie about in one line, so that slopes across it, to {sides}, are uncertain; add lights "
                "on both of these sides"
            )
        elif gaps[k] > GAP_DEG:
            side = _side(around[k] + gaps[k] / 2)
            found.append(
                f"no light comes from the {side} ({gaps[k]:.0f} degrees of the circle are empty), so that side of the "
                "object lies in shadow; add lights there"
            )
    if not found and numbers["condition"] > UNEVEN:
        found.append(
            f"the lights are uneven (condition number {numbers['condition']:.0f}); spread them around the camera's axis"
        )
    below = lights_behind(L)
    if below.size:
        found.append(
            f"{counted(len(below), 'light lies', 'lights lie')} behind the object (z below 0); z has to point from the "
            "object to the camera, so change the sign of z in the file, or choose the other pictures with --images"
        )
    return [Finding("coverage", bool(below.size), f"{line}.", numbers) for line in found]


def polar_plot(L: Float[np.ndarray, "n 3"], names: list[str] | None = None) -> UInt8[np.ndarray, "s s 3"]:
    """The lights as the camera sees them: azimuth around, degrees from the axis outwards, numbers count from 1."""
    import cv2

    picture = np.full((SIZE, SIZE, 3), 255, np.uint8)
    c, r = SIZE // 2, SIZE // 2 - 46  # 90 degrees
    for deg in (30, 60, 90):
        cv2.circle(picture, (c, c), round(r * deg / 90), (205, 205, 205), 1, cv2.LINE_AA)
        cv2.putText(picture, str(deg), (c + 4, c - round(r * deg / 90) - 4), 0, 0.4, (140, 140, 140), 1, cv2.LINE_AA)
    cv2.line(picture, (c - r, c), (c + r, c), (225, 225, 225), 1)
    cv2.line(picture, (c, c - r), (c, c + r), (225, 225, 225), 1)
    for text, x, y in (("right", c + r + 4, c + 4), ("left", 8, c + 4), ("up", c - 8, 20), ("down", c - 18, SIZE - 10)):
        cv2.putText(picture, text, (x, y), 0, 0.4, (110, 110, 110), 1, cv2.LINE_AA)
    zenith = np.degrees(np.arccos(L[:, 2].clip(-1, 1))).clip(0, 100)
    azimuth, behind = np.arctan2(L[:, 1], L[:, 0]), lights_behind(L)
    for j, (z, a) in enumerate(zip(zenith, azimuth, strict=True)):
        x, y = round(c + r * z / 90 * np.cos(a)), round(c - r * z / 90 * np.sin(a))
        colour = (200, 60, 20) if j in behind else (20, 110, 200)
        cv2.circle(picture, (x, y), 4, colour, -1, cv2.LINE_AA)
        label = names[j] if names else str(j + 1)
        cv2.putText(picture, label, (x + 6, y - 4), 0, 0.35, (90, 90, 90), 1, cv2.LINE_AA)
    return picture


def _side(azimuth_deg: float) -> str:
    sides = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom", "lower right")
    return sides[round(azimuth_deg / 45) % 8]
