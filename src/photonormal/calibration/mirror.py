"""Light directions and positions from reflections on mirror spheres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from photonormal.calibration.circle import Circle
from photonormal.geometry import normalised
from photonormal.types import InputError

PARALLEL = 1e-4  # smallest eigenvalue, relative, below which lines do not fix the point nearest to them


def reflect(N: Float[np.ndarray, "*b 3"], V: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
    """l = 2 (n.v) n - v: the light that a mirror with normal n shows to a viewer towards v."""
    return 2 * (N * V).sum(-1, keepdims=True) * N - V


def directions(
    circle: Circle,
    highlights: Float[np.ndarray, "n 2"],
    focal_px: float | None = None,
    centre: tuple[float, float] = (0.0, 0.0),
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Unit directions from a sphere to its lights, and the points in radii of the sphere where they were reflected.

    Frame: x right, y up, z to the camera. Orthographic for `focal_px` None: the view is (0, 0, 1) and points count from
    the sphere's centre. Perspective: from the camera, whose focal length is `focal_px` and whose axis meets the picture
    at `centre`; the outline is then the cone that touches the sphere, and the view changes from pixel to pixel.
    """
    if focal_px is None:
        xy = (highlights - (circle.x, circle.y)) * (1, -1) / circle.r  # (n, 2)
        r2 = (xy**2).sum(1).clip(0, 1)
        N = np.column_stack([xy, np.sqrt(1 - r2)])
        return reflect(N, np.broadcast_to([0.0, 0.0, 1.0], N.shape)), N
    C = sphere_centre(circle, focal_px, centre)  # (3,)
    D = _rays(highlights, focal_px, centre)  # (n, 3)
    b = D @ C
    t = b - np.sqrt((b**2 - C @ C + 1).clip(0))  # |t d - C| = 1, the nearer point
    P = t[:, None] * D
    return reflect(normalised(P - C), -D), P


def sphere_centre(circle: Circle, focal_px: float, centre: tuple[float, float]) -> Float[np.ndarray, " 3"]:
    """A sphere's centre from the camera, in radii of the sphere: the axis of the cone of rays that touch it."""
    offset = np.array([circle.x - centre[0], centre[1] - circle.y])
    d = float(np.hypot(*offset))
    long = circle.r  # half the outline's length on the line to the picture's centre: it is an ellipse, long that way,
    half = axis = 0.0  # and the circle's radius is the mean of its half axes
    for _ in range(5):
        near, far = np.arctan((d - long) / focal_px), np.arctan((d + long) / focal_px)
        half, axis = (far - near) / 2, (far + near) / 2
        across = focal_px * np.sin(half) / np.sqrt(np.cos(axis) ** 2 - np.sin(half) ** 2)
        long *= circle.r / ((long + across) / 2)
    along = offset / d if d > 0 else np.zeros(2)
    direction = np.array([*(along * np.sin(axis)), -np.cos(axis)])
    return direction / np.sin(half)


def nearest_point(
    points: Float[np.ndarray, "m 3"], lines: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, " 3"], float]:
    """The point nearest to lines through `points` along unit `lines`, and the root mean square of its distances.

    Minimises sum_k |(I - l_k l_k^T) (x - p_k)|^2.

    Raises
    ------
    InputError
        If the lines are parallel in practice: the light is too far away for its position to be found.
    """
    M = np.eye(3) - lines[:, :, None] * lines[:, None, :]  # (m, 3, 3)
    A = M.sum(0)
    if np.linalg.eigvalsh(A)[0] < PARALLEL * len(lines):
        raise InputError(
            "the spheres see a light in the same direction to within a degree, so its position can't be found; "
            "set the spheres further apart, or use the light's direction only."
        )
    x = np.linalg.solve(A, np.einsum("kij,kj->i", M, points))
    return x, float(np.sqrt(((M @ (x - points)[..., None]) ** 2).sum((1, 2)).mean()))


def mean_directions(each: Sequence[Float[np.ndarray, "n 3"]]) -> Float[np.ndarray, "n 3"]:
    """The mean of several spheres' directions."""
    return normalised(np.sum(each, axis=0))


def _rays(xy: Float[np.ndarray, "n 2"], focal_px: float, centre: tuple[float, float]) -> Float[np.ndarray, "n 3"]:
    """Unit rays from the camera through pixels, x right, y up, z against the view."""
    offset = (xy - centre) * (1, -1)
    return normalised(np.column_stack([offset, np.full(len(offset), -focal_px)]))
