"""Lights given in another frame: an axis flipped, x and y exchanged, turned about the view.

Turning or mirroring all lights does the same to the normals and leaves every picture explained as well as before. The
surface tells them apart. Slopes p = dz/dx and q = dz/dy of a real surface obey dp/dy = dq/dx; mirrored or turned
normals do not. Half a turn keeps that too, but then normals at the outline point inwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from photonormal.check.finding import Finding

STEP_DEG = 5  # of the turns tried
SMALL_DEG = 15  # turns below that are no mistake of a frame
CLEARLY, MORE = 0.9, 0.02  # curl of another frame, as part of the given one's, and less by, at which it is reported
STEEP = 0.25  # n_z below which slopes are not used
AGREES = 0.3  # by how much the outline has to prefer another frame, of 2
LEAST = 200  # places where slopes are known, and 60 of an outline, at least
OUTLINE = 60
MIRRORED = {
    0: "y is flipped (y counts downwards)",
    -180: "x is flipped",
    90: "x and y are exchanged",
    -90: "x and y are exchanged and both flipped",
}


@dataclass(frozen=True)
class Frame:
    """Normals as they would be: y flipped if `mirrored`, then turned by `turn_deg` counter-clockwise."""

    mirrored: bool
    turn_deg: int

    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """(3, 3), to be applied to columns."""
        c, s = np.cos(np.radians(self.turn_deg)), np.sin(np.radians(self.turn_deg))
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag([1.0, -1.0 if self.mirrored else 1.0, 1.0])

    def name(self) -> str:
        """What was done to the lights."""
        turn = (self.turn_deg + 180) % 360 - 180
        if self.mirrored:
            return MIRRORED.get(turn, f"y is flipped and the lights are turned by {-turn} degrees")
        return "x and y are both flipped" if turn == -180 else f"the lights are turned by {-turn} degrees"


GIVEN = Frame(False, 0)


def slopes_curl(N: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> dict[Frame, float] | None:
    """How far normals in each frame, half turns aside, are from any surface's: 0 to 1; None where too few are known."""
    known = mask & (N[..., 2] > STEEP)
    z = np.where(known, N[..., 2], 1)
    p, q = -N[..., 0] / z, -N[..., 1] / z
    whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    if whole.sum() < LEAST:
        return None

    def along_x(f: np.ndarray) -> np.ndarray:
        return (f[:-1, 1:] - f[:-1, :-1] + f[1:, 1:] - f[1:, :-1])[whole] / 2

    def along_y(f: np.ndarray) -> np.ndarray:  # y up: rows run against it
        return (f[:-1, :-1] - f[1:, :-1] + f[:-1, 1:] - f[1:, 1:])[whole] / 2

    p_x, p_y, q_x, q_y = along_x(p), along_y(p), along_x(q), along_y(q)
    size = np.hypot(p_y - q_x, q_y + p_x) + np.hypot(p_y + q_x, p_x - q_y)
    weight = np.minimum(size, np.quantile(size, 0.9)) / np.maximum(size, 1e-12)  # edges count once
    total = float((weight * size).sum()) or 1.0
    found = {}
    for mirrored in (False, True):
        # turned by a: p' = p cos a - q sin a, q' = p sin a + q cos a; dp'/dy - dq'/dx = A cos a - B sin a
        A, B = (p_y + q_x, p_x - q_y) if mirrored else (p_y - q_x, q_y + p_x)
        for deg in range(0, 180, STEP_DEG):
            a = np.radians(deg)
            found[Frame(mirrored, deg)] = float((weight * np.abs(A * np.cos(a) - B * np.sin(a))).sum()) / total
    return found


def outline(
    N: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]] | None:
    """Normals' (x, y) along the mask's outline and the outward directions there; None where the frame cuts the mask."""
    import cv2

    padded = cv2.copyMakeBorder(mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    edge = mask & (cv2.erode(padded, np.ones((5, 5), np.uint8))[1:-1, 1:-1] == 0)
    edge[:3] = edge[-3:] = False
    edge[:, :3] = edge[:, -3:] = False
    if edge.sum() < OUTLINE:
        return None
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 3.0)
    away = np.stack([-cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)], axis=-1)[edge]
    length = np.linalg.norm(away, axis=1, keepdims=True)
    return N[edge][:, :2], away / np.maximum(length, 1e-9)


def outwards(found: tuple[np.ndarray, np.ndarray], frame: Frame) -> float:
    """1 where all normals along the outline point outwards in that frame, -1 where all point inwards."""
    n, away = found
    return float((n @ frame.matrix()[:2, :2].T * away).sum() / max(np.linalg.norm(n, axis=1).sum(), 1e-9))


def best_frame(N: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> tuple[Frame, dict[str, float]]:
    """The frame in which the normals are a surface's, GIVEN unless another one clearly is, and the figures."""
    curl = slopes_curl(N, mask)
    if curl is None:
        return GIVEN, {}
    best = min(curl, key=lambda f: curl[f])
    numbers = {"curl": round(curl[GIVEN], 4), "curl_best": round(curl[best], 4)}
    turn = min(best.turn_deg, 180 - best.turn_deg)
    if curl[best] > min(CLEARLY * curl[GIVEN], curl[GIVEN] - MORE) or (not best.mirrored and turn < SMALL_DEG):
        best = GIVEN
    rim = outline(N, mask)
    if rim is None:
        return best, numbers
    usual = round(best.turn_deg / 45) * 45
    if best.mirrored and abs(best.turn_deg - usual) <= 20:  # the turn of a mirroring is known to some degrees only
        best = Frame(True, usual)
    options = [Frame(best.mirrored, (best.turn_deg + half) % 360) for half in (0, 180)]
    best = max(options, key=lambda f: outwards(rim, f))
    numbers |= {"outline": round(outwards(rim, GIVEN), 4), "outline_best": round(outwards(rim, best), 4)}
    if best != GIVEN and outwards(rim, best) < outwards(rim, GIVEN) + AGREES:
        return GIVEN, numbers
    return best, numbers


def wrong_frame(
    N: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> tuple[Finding, Float[np.ndarray, "3 3"]] | None:
    """The lights' frame, if the normals `N` that they give are no surface's, and what corrects the lights."""
    if (N[mask][:, 2] < 0).mean() > 0.5:
        finding = Finding(
            "frame",
            True,
            "the normals point away from the camera: z of the lights is flipped; turn its sign in the lights' file, or "
            "use --frame.",
        )
        return finding, np.diag([1.0, 1.0, -1.0])
    best, numbers = best_frame(N, mask)
    if best == GIVEN:
        return None
    hollow = " (or the object is hollow)" if not best.mirrored and best.turn_deg == 180 else ""
    finding = Finding(
        "frame",
        True,
        f"the lights' frame disagrees with the pictures: {best.name()}{hollow}; x is right, y up and z to the camera "
        "here, so correct the lights' file.",
        numbers | {"frame": best.name()},
    )
    return finding, best.matrix()
