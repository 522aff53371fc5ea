"""A mirror sphere's outline from how its rim fades into its surroundings.

Where the view grazes a sphere its reflectance is 1 and it mirrors what lies right behind it: the brightness goes over
into the surroundings' without a step, as (1 - cos)^5 (Schlick), and is steepest inside the outline. What the sphere
scatters itself, or a rim that does not mirror, ends in a step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from photonormal.calibration.circle import Circle

LINEAR = 4.4  # power that makes square roots of levels encoded as pictures are proportional to light
SECTORS, IN_SECTOR = 48, 10  # around the circle, and directions averaged in each
WINDOW = (6.0, 0.05)  # half the width looked at, in pixels of the photographs and in radii; the larger counts
FARTHEST = 0.7  # of that width that the radius moves at most
SMALL = 40.0  # radius in pixels of the photographs up to which the centre is fitted, too; shadows pull larger ones
INWARDS = 0.5  # pixels that an outline may lie inside the steepest place, which it never does but for noise
STEP_COSTS = 1e-3  # of a step beside the fading, for each sample: on small spheres the two look alike


def faded(mean: Float[np.ndarray, "h w"], circle: Circle, pixel: float = 1.0) -> Circle:
    """The circle at which the surroundings of a mirror sphere begin; about the same centre, unless the sphere is small.

    Least squares over the radius, the blur and a small sphere's centre; in each sector the brightness on both sides,
    the fading and the step are free. Sectors that shadows cross count less (soft L1). A circle of edges lies inside the
    outline; where the fit ends further inside it found something else, and the circle is returned as it came.

    Parameters
    ----------
    mean : light (h, w), the mean of all photographs
    pixel : width of a photograph's pixel in it
    """
    import cv2

    half = max(WINDOW[0] * pixel, WINDOW[1] * circle.r)
    step = max(0.25, half / 40)
    t = np.arange(-half, half + step / 2, step)  # (m,) from the circle outwards
    phi = 2 * np.pi * (np.arange(SECTORS * IN_SECTOR) + 0.5)[:, None] / (SECTORS * IN_SECTOR)
    x, y = circle.x + np.cos(phi) * (circle.r + t), circle.y + np.sin(phi) * (circle.r + t)
    light = cv2.remap(
        mean, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    P = light.reshape(SECTORS, IN_SECTOR, -1).mean(1).astype(np.float64)[..., None]  # (sectors, m, 1)
    middle = phi.reshape(SECTORS, IN_SECTOR).mean(1)
    across = np.stack([np.cos(middle), np.sin(middle)], axis=-1)  # (sectors, 2)

    def off(p: np.ndarray) -> np.ndarray:
        r, blur, moved = p[0], p[1], across @ p[2:] if len(p) > 2 else np.zeros(SECTORS)
        B = _rim(t + circle.r - r - moved[:, None], r, blur, step)  # (sectors, m, 5)
        Bt = B.swapaxes(1, 2)
        G = Bt @ B + len(t) * np.diag([1e-6, STEP_COSTS, 1e-6, 1e-6, 1e-6])
        return (P - B @ np.linalg.solve(G, Bt @ P)).ravel()

    from scipy.optimize import least_squares

    centre = 2 if circle.r < SMALL * pixel else 0  # unknowns
    start, far = np.array([circle.r, pixel] + [0.0] * centre), FARTHEST * half
    found = least_squares(
        off,
        start,
        bounds=([circle.r - far, 0.3] + [-far] * centre, [circle.r + far, 3 * pixel + 0.5] + [far] * centre),
        jac=lambda p: _slopes(off, p, np.array([0.05 * pixel] * len(p))),  # pyright: ignore[reportArgumentType]  its stubs know names only
        loss="soft_l1",
        f_scale=max(1.5 * float(np.median(np.abs(off(start)))), 1e-4),
        x_scale=[0.5 * pixel, 0.5] + [0.5 * pixel] * centre,
        max_nfev=30,
    )
    if found.x[0] < circle.r - INWARDS * pixel:
        return circle
    dx, dy = found.x[2:] if centre else (0.0, 0.0)
    return replace(circle, x=circle.x + float(dx), y=circle.y + float(dy), r=float(found.x[0]))


def _slopes(f: Callable[[np.ndarray], np.ndarray], p: np.ndarray, h: np.ndarray) -> Float[np.ndarray, "m k"]:
    """Derivatives of f by each of the unknowns, over steps `h`."""
    return np.stack([(f(p + d) - f(p - d)) / (2 * d.sum()) for d in np.diag(h)], axis=-1)


def _rim(u: np.ndarray, r: float, blur: float, step: float) -> Float[np.ndarray, "*b 5"]:
    """Fading, step, slopes outside and inside, and 1, at distances `u` from an outline of radius r, blurred."""
    from scipy.ndimage import gaussian_filter1d

    margin = 4 * blur + 2 * step
    fine = np.arange(u.min() - margin, u.max() + margin, step)
    cosine = np.sqrt(1 - (1 + fine / r).clip(0, 1) ** 2)
    width = u.max() - u.min()
    curves = ((1 - cosine) ** 5, (fine / step + 0.5).clip(0, 1), fine.clip(0) / width, fine.clip(max=0) / width)
    shown = [np.interp(u, fine, gaussian_filter1d(c, blur / step, mode="nearest")) for c in curves]
    return np.stack([*shown, np.ones_like(u)], axis=-1)
