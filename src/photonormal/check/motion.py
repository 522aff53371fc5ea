"""Pictures that are shifted against the others: a camera or an object that moved."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from photonormal.check.finding import Finding, listed

FARTHEST = 25.0  # pixels: larger shifts are mistakes of the estimate
SHIFT = 1.3  # pixels that shading alone can feign
GAIN = 0.03  # of correlation that a shift brings at least


def shifts(
    edges: Float[np.ndarray, "n a b"], expected: Float[np.ndarray, "n a b"] | None = None
) -> Float[np.ndarray, "n 2"]:
    """Shift (x right, y down) in pixels of each picture against the mean of the others; 0 where it is not certain.

    `expected` is compared with instead, where it is given.

    Phase correlation finds it; it counts if correlation of the edges confirms it.
    """
    import cv2

    total, n = edges.sum(0), len(edges)
    window = cv2.createHanningWindow(edges.shape[:0:-1], cv2.CV_32F)
    found = np.zeros((n, 2))
    for j, edge in enumerate(edges):
        others = (total - edge) / (n - 1) if expected is None else expected[j]
        (x, y), _ = cv2.phaseCorrelate(_centred(others), _centred(edge), window)
        if SHIFT < np.hypot(x, y) < FARTHEST and _gain(others, edge, round(x), round(y)) > GAIN:
            found[j] = x, y
    return found


def motion(
    edges: Float[np.ndarray, "n a b"],
    scale: float,
    names: list[str],
    expected: Float[np.ndarray, "n a b"] | None = None,
) -> list[Finding]:
    """Pictures that moved; `scale` is that of `edges` against the photographs."""
    if min(edges.shape[1:]) < 32:
        return []
    shift = shifts(edges, expected) / scale
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


def _centred(picture: np.ndarray) -> np.ndarray:
    return (picture - picture.mean()).astype(np.float32)


def _gain(others: np.ndarray, edge: np.ndarray, x: int, y: int) -> float:
    """Rise of the correlation when the others are shifted by (x, y)."""
    m = max(abs(x), abs(y))
    if 3 * m >= min(edge.shape):
        return 0.0
    inner = edge[m : edge.shape[0] - m, m : edge.shape[1] - m]
    a, b = (others[m - s[1] : edge.shape[0] - m - s[1], m - s[0] : edge.shape[1] - m - s[0]] for s in ((x, y), (0, 0)))
    return float(np.corrcoef(a.ravel(), inner.ravel())[0, 1] - np.corrcoef(b.ravel(), inner.ravel())[0, 1])
