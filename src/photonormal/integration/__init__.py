"""Normals -> Surface. Every method is a callable ``(normals, K) -> Surface`` and one line of METHODS."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from photonormal.lookup import lookup
from photonormal.types import InputError, Normals, Surface, as_normals, by_name

METHODS = {  # name -> "module:Class", imported only when asked for
    "simchony": "photonormal.integration.simchony:Simchony",
    "quadratic": "photonormal.integration.quadratic:Quadratic",
    "bilateral": "photonormal.integration.bilateral:Bilateral",
    "periodic": "photonormal.integration.periodic:Periodic",
}

DEFAULT = "quadratic"


def configure(method: str, **options: Any) -> Callable[[Normals, np.ndarray | None], Surface]:
    """A method with its options set; InputError names what exists where the method or an option does not."""
    cls = lookup(by_name("integration", method, METHODS))
    if unknown := sorted(set(options) - set(cls.__dataclass_fields__)):
        known = ", ".join(cls.__dataclass_fields__) or "none"
        raise InputError(f"{method} has no option {unknown[0]!r}; it has {known}.")
    return cls(**options)


def integrate(
    normals: Normals | np.ndarray, method: str = DEFAULT, K: np.ndarray | None = None, **options: Any
) -> Surface:
    """Depth from normals.

    Parameters
    ----------
    normals : unit normals, x right, y up, z to the camera, on a mask that may have several parts and holes; or their
        map (h, w, 3)
    method : a key of METHODS. `simchony` is the fastest, for masks that nearly fill their rectangle; `quadratic` serves
        any mask; `bilateral` lets the depth jump; `periodic` is for tiles, whose edges meet
    K : (3, 3) camera matrix of a perspective view in pixels (x right, y down, the first pixel's centre at (0, 0); a
        crop moves the principal point). None: an orthographic view
    options : the method's fields, by name

    Returns
    -------
    Surface
        Orthographic: height towards the camera in pixels, zero mean. Perspective: distance along the optical axis, mean
        one. This holds for each connected part (4 neighbours) alone: nothing relates parts that don't touch.

    Raises
    ------
    InputError
        If the method or an option does not exist, `K` is no camera matrix, or the mask is empty.
    """
    solver = configure(method, **options)
    normals = as_normals(normals)
    if not normals.mask.any():
        raise InputError("no pixel has a normal but integration needs some; check the mask.")
    return solver(normals, None if K is None else camera_matrix(K))


def camera_matrix(K: Any) -> np.ndarray:
    """`K` as a (3, 3) float array; raises InputError where it is no camera matrix."""
    M = np.asarray(K, dtype=np.float64)
    if M.shape != (3, 3) or not np.isfinite(M).all() or not (M[0, 0] > 0 and M[1, 1] > 0 and (M[2] == (0, 0, 1)).all()):
        raise InputError(
            f"the camera matrix is {M.tolist() if M.size == 9 else M.shape} but 3 x 3 finite numbers with positive "
            "focal lengths are needed; give fx 0 cx, 0 fy cy, 0 0 1 in pixels."
        )
    return M
