"""Intensities of the lights, one for each, up to a common factor: from the object itself or from a diffuse reference.

Self-calibration is semi-calibrated photometric stereo: directions known, intensities not (D. Cho, Y. Matsushita,
Y.-W. Tai, I. Kweon, "Photometric stereo under non-uniform light intensities and exposures", ECCV 2016).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from photonormal.types import InputError

SHADOW = 0.02  # of the 99th percentile: darker samples may be in shadow
CAP = 0.97  # quantile of each light's samples at which they are cut: highlights say nothing of the light
FACING = 0.2  # n.l above which a sample shows its light's intensity
LEAST = 20  # samples of a light that show its intensity at least
TIGHT = 1.5  # residuals beyond this many medians of a pixel are highlights or cast shadows


def self_calibrated(
    I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"], rounds: int = 10
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "p 3"]]:
    """Intensities e (n,), their geometric mean 1, and scaled normals b (p, 3) such that I_pj = e_j max(b_p.l_j, 0).

    Alternates robust least squares for b with the median ratio for e, from equal intensities and from the linear
    solution; the better fit is kept. A light that fewer than LEAST samples see keeps its first value.
    """
    I = np.minimum(I, np.quantile(I, CAP, axis=0))
    lit = I > SHADOW * np.quantile(I, 0.99)
    fits = [_alternated(I, L, lit, start, rounds) for start in (np.ones(len(L)), linear_intensities(I, L))]
    return min(fits, key=lambda fit: misfit(I / fit[0], L, lit, fit[1]))


def misfit(
    I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"], lit: Bool[np.ndarray, "p n"], b: Float[np.ndarray, "p 3"]
) -> float:
    """Mean over lit samples of |I_pj - l_j.b_p|, each counted up to a tenth of the pixel's |b_p|, as part of |b_p|."""
    size = np.linalg.norm(b, axis=1, keepdims=True)
    return float(np.minimum(np.abs(I - b @ L.T) / size.clip(1e-12), 0.1)[lit].mean())


def _alternated(
    I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"], lit: Bool[np.ndarray, "p n"], e: np.ndarray, rounds: int
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "p 3"]]:
    b = robust_normals(I / e, L, lit)
    for _ in range(rounds):
        s = b @ L.T  # (p, n)
        usable = lit & (s > FACING * np.linalg.norm(b, axis=1, keepdims=True))
        change = np.ones_like(e)
        for j in np.flatnonzero(usable.sum(0) >= LEAST):
            k = usable[:, j]
            change[j] = np.median(I[k, j] / (e[j] * s[k, j]))
        e = _normalised(e * change)
        b = robust_normals(I / e, L, lit)
        if np.abs(np.log(change / change.mean())).max() < 1e-3:
            break
    return e, b


def linear_intensities(
    I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"], rounds: int = 6
) -> Float[np.ndarray, " n"]:
    """The intensities that make the most Lambertian half of the pixels as Lambertian as can be.

    With w = 1 / e a pixel's residual is |(I - L L^+) diag(i_p) w|^2; their sum is w^T M w with
    M = (I - L L^+) o (sum_p i_p i_p^T), whose smallest eigenvector is w. Starts from the pixels with the fewest shadows
    and goes on with those of least residual. Ones, where w has mixed signs: too little of some light is seen.
    """
    n = len(L)
    J = I / np.linalg.norm(I, axis=1, keepdims=True).clip(1e-12)
    P = np.eye(n) - L @ np.linalg.pinv(L)
    dark = (I <= SHADOW * np.quantile(I, 0.99)).sum(1)
    keep, w = dark <= np.quantile(dark, 0.25), np.ones(n)
    for _ in range(rounds):
        w = np.linalg.eigh(P * (J[keep].T @ J[keep]))[1][:, 0]
        w = w * np.sign(w.sum())
        residual = np.linalg.norm((J * w) @ P, axis=1) / np.linalg.norm(J * w, axis=1).clip(1e-12)
        keep = residual <= np.median(residual)
    if n < 5 or w.min() < 0.02 * w.max():
        return np.ones(n)
    return _normalised(1 / w)


def robust_normals(
    I: Float[np.ndarray, "p n"], L: Float[np.ndarray, "n 3"], lit: Bool[np.ndarray, "p n"], rounds: int = 3
) -> Float[np.ndarray, "p 3"]:
    """b = argmin sum_j w_j (l_j.b - I_j)^2, w_j = 1 where a sample is lit and within TIGHT medians of the fit."""
    LL = (L[:, :, None] * L[:, None, :]).reshape(-1, 9)  # (n, 9)
    b = I @ np.linalg.pinv(L).T
    for _ in range(rounds):
        r = np.abs(I - b @ L.T)
        tight = np.where(lit, r, np.nan)
        with np.errstate(all="ignore"):
            middle = np.nan_to_num(_nanmedian(tight), nan=np.inf)
        w = (lit & (r <= TIGHT * middle[:, None] + 1e-6 * I.max())).astype(float)
        A = (w @ LL).reshape(-1, 3, 3)
        ridge = 1e-4 * np.trace(A, axis1=1, axis2=2)[:, None, None] / 3 + 1e-9
        b = np.linalg.solve(A + ridge * np.eye(3), ((w * I) @ L + ridge[..., 0] * b)[..., None])[..., 0]
    return b


def from_reference(
    levels: Float[np.ndarray, "n c"],
    what: str,
    normal: Float[np.ndarray, " 3"] | None = None,
    lights: Float[np.ndarray, "n 3"] | None = None,
) -> Float[np.ndarray, "n c"]:
    """Intensities (n, c) from the mean levels of a diffuse reference under each light, their mean 1.

    A flat matt reference facing `normal` shows e_j n.l_j: with `lights` the cosine is divided out.
    """
    if not (np.isfinite(levels) & (levels > 0)).all():
        j = int(np.flatnonzero(~(np.isfinite(levels) & (levels > 0)).all(1))[0])
        raise InputError(f"picture {j + 1} of {what} is black but light is needed on it; photograph it again.")
    if normal is not None and lights is not None:
        cosine = lights @ normal
        if cosine.min() < 0.05:
            j = int(cosine.argmin())
            raise InputError(
                f"light {j + 1} grazes or misses {what} (cosine {cosine[j]:.2f}); turn the reference to the camera."
            )
        levels = levels / cosine[:, None]
    return levels / levels.mean()


def _nanmedian(values: Float[np.ndarray, "p n"]) -> Float[np.ndarray, " p"]:
    """Median of each row's numbers; numpy's own warns of empty rows and is slow."""
    ranked = np.sort(values, axis=1)  # NaN last
    count = np.isfinite(ranked).sum(1)
    return ranked[np.arange(len(ranked)), np.maximum(count - 1, 0) // 2]


def _normalised(e: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return e / np.exp(np.log(e).mean())
