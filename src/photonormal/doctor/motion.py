"""Pictures that are shifted against the others: a camera or an object that moved.

What a picture should show is told by the others, whatever the lights: pictures of a matt surface are combinations of
three, of others of few more. A picture that moved fits that only after it is shifted back.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from photonormal.doctor.finding import Finding, listed

SIZE = 32  # pixels of the smaller side, at least
FARTHEST = 12  # pixels of a shift looked for, and at most this part of the smaller side
PART = 5
RANK = 4  # pictures that the others are combined of
DETAIL = 3.0  # pixels: coarser shading moves with the light
ALIKE = 0.5  # correlation with what the others show, after the shift, at least
UNEXPLAINED = 0.65  # of a picture's detail after the shift, as part of before, at which it moved


def combined(pictures: Float[np.ndarray, "n a b"]) -> Float[np.ndarray, "n a b"]:
    """Each picture as the principal ones of the others show it."""
    n = len(pictures)
    A = pictures.reshape(n, -1)
    G, shown = A @ A.T, np.empty_like(A)
    for j in range(n):
        others = np.delete(np.arange(n), j)
        V = np.linalg.eigh(G[np.ix_(others, others)])[1][:, -min(RANK, n - 2) :]  # (n - 1, r)
        weights = np.linalg.pinv(V.T @ G[np.ix_(others, others)] @ V, hermitian=True) @ V.T @ G[others, j]
        shown[j] = (V @ weights) @ A[others]
    return shown.reshape(pictures.shape)


def shifts(pictures: Float[np.ndarray, "n a b"]) -> Float[np.ndarray, "n 2"]:
    """Shift (x right, y down) in pixels of each picture against what the others show; 0 where it is not certain."""
    import cv2

    r = min(FARTHEST, min(pictures.shape[1:]) // PART)
    seen = np.sqrt((pictures / max(float(np.quantile(pictures, 0.99)), 1e-9)).clip(0, 1.4))
    found = np.zeros((len(seen), 2))
    for j, shown in enumerate(combined(seen)):
        fit = cv2.matchTemplate(_detail(seen[j]), _detail(shown)[r:-r, r:-r], cv2.TM_CCOEFF_NORMED)  # (2 r + 1)^2
        y, x = np.unravel_index(int(fit.argmax()), fit.shape)
        inside = 0 < x < 2 * r and 0 < y < 2 * r and fit[y, x] > ALIKE
        if inside and (x, y) != (r, r) and 1 - fit[y, x] < UNEXPLAINED * (1 - fit[r, r]):
            found[j] = x - r + _peak(fit[y, x - 1 : x + 2]), y - r + _peak(fit[y - 1 : y + 2, x])
    return found


def motion(pictures: Float[np.ndarray, "n a b"], scale: float, names: list[str]) -> list[Finding]:
    """Pictures that moved; `scale` is that of `pictures` against the photographs."""
    if min(pictures.shape[1:]) < SIZE or len(pictures) < RANK + 2 or not pictures.any():
        return []
    shift = shifts(pictures) / scale
    moved = np.flatnonzero(np.abs(shift).max(1) > 0)
    if not moved.size:
        return []
    moved = moved[np.argsort(-np.linalg.norm(shift[moved], axis=1))]
    text = listed([f"{names[j]} by ({shift[j, 0]:+.1f}, {shift[j, 1]:+.1f}) px" for j in moved])
    return [
        Finding(
            "motion",
            True,
            f"{len(moved)} pictures are shifted against the others ({text}; right and down are positive); align them, "
            "or leave them out and fix camera and object.",
            {"shifts_px": {names[j]: [round(float(v), 2) for v in shift[j]] for j in moved}},
        )
    ]


def _detail(picture: np.ndarray) -> np.ndarray:
    import cv2

    picture = picture.astype(np.float32)
    return picture - cv2.GaussianBlur(picture, (0, 0), DETAIL)


def _peak(values: np.ndarray) -> float:
    """Where the parabola through three values has its top, from the middle one."""
    before, at, after = (float(v) for v in values)
    return 0.5 * (before - after) / min(before - 2 * at + after, -1e-9)
