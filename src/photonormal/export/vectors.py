"""What the samples of a picture say as vectors: their scale, the code that means zero, what is background."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from photonormal.files.decode import full_scale

EDGE = 0.8  # vectors whose parts are all beyond it, on one side, are black or white: a unit vector's can't be
SHORTEST = 0.1  # mid-grey is shorter
NEGATIVE = -0.05  # floats below it are vectors themselves, no (n + 1) / 2
NEAR = 0.02  # of length one: vectors that show the code of zero
CUT_OUT = 0.02  # alpha within it of 0 or 1 is a cut-out's


def decoded_vectors(samples: np.ndarray) -> Float[np.ndarray, "h w c"]:
    """Parts of vectors in [-1, 1], float32: integers hold (n + 1) / 2, floats that or the vectors themselves."""
    full = full_scale(samples)
    if full > 1:
        return (samples / np.float32(full / 2) - 1).astype(np.float32)
    given = samples.astype(np.float32)
    if np.nanmin(given, initial=0) < NEGATIVE or given.shape[2] < 3:
        return given
    encoded = 2 * given - 1
    return encoded if of_unit_length(encoded) > of_unit_length(given) else given


def of_unit_length(v: Float[np.ndarray, "h w c"]) -> float:
    """The share of vectors of about unit length."""
    return float((np.abs(np.linalg.norm(v, axis=-1) - 1) < 0.1).mean())


def is_background(v: Float[np.ndarray, "h w c"]) -> Bool[np.ndarray, "h w"]:
    """Black, white and mid-grey, and what is no number; of two channels mid-grey is flat, not background."""
    grey = np.linalg.norm(v, axis=-1) < SHORTEST if v.shape[2] > 2 else np.zeros(v.shape[:2], bool)
    return grey | (v < -EDGE).all(-1) | (v > EDGE).all(-1) | ~np.isfinite(v).all(-1)


def is_transparent(alpha: np.ndarray) -> Bool[np.ndarray, "h w"]:
    """Where the picture is cut out; nowhere if alpha holds something else, such as gloss or height, or is unused."""
    a = alpha / np.float32(full_scale(alpha))
    cut_out = float(((a < CUT_OUT) | (a > 1 - CUT_OUT)).mean()) > 0.5 and a.max() > 0.5
    return (a < 0.5) if cut_out else np.zeros(a.shape, bool)


def zero_at_its_code(v: Float[np.ndarray, "p 3"], step: float) -> Float[np.ndarray, "p 3"]:
    """Vectors from integers, with zero where the program that wrote them put it: half way between two codes, or at one
    of the two (127 or 128 of 255).

    Lengths show: |n + d|^2 grows by 2 d (n_x + n_y) with an offset d. Where they don't, a flat map is flat: if one of
    the four codes around zero is far more frequent than the others, it is zero.

    Parameters
    ----------
    step : from one code to the next
    """
    half = step / 2
    d = _offset(v, half)
    v = v - np.float32(d)
    if d == 0:
        around = (np.abs(v[:, :2]) < 1.01 * half).all(-1)
        up = v[:, :2] > 0
        kinds = np.bincount((2 * up[:, 0] + up[:, 1])[around], minlength=4)
        most = int(kinds.argmax())
        if most in (0, 3) and 2 * kinds[most] > 3 * (kinds.sum() - kinds[most]):
            v[around & (up == bool(most)).all(-1), :2] = 0
    return v


def _offset(v: Float[np.ndarray, "p 3"], half: float) -> float:
    """0, or half a step up or down; 0 where lengths don't show."""
    squared = (v.astype(np.float64) ** 2).sum(-1)
    sure = np.abs(squared - 1) < 2 * NEAR
    along, longer = v[sure, 0].astype(np.float64) + v[sure, 1], squared[sure] - 1
    spread = float(along.var()) if sure.any() else 0.0
    if not spread:
        return 0.0
    error = float(longer.std()) / (2 * np.sqrt(spread * len(along)))
    slope = float(((along - along.mean()) * longer).mean()) / (2 * spread)
    return half * float(np.clip(np.rint(slope / half), -1, 1)) if error < half / 5 else 0.0
