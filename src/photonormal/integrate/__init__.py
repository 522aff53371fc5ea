"""Normals -> Surface. Every method is a callable ``(normals, K) -> Surface`` and one line of METHODS."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from photonormal.types import InputError, Normals, Surface

METHODS = {  # name -> "module:Class", imported only when asked for
    "simchony": "photonormal.integrate.simchony:Simchony",
    "quadratic": "photonormal.integrate.quadratic:Quadratic",
    "bilateral": "photonormal.integrate.bilateral:Bilateral",
}

DEFAULT = "quadratic"


def configure(method: str, **options: Any) -> Any:
    """A method with its options set; InputError names what exists where the method or an option does not."""
    if method not in METHODS:
        raise InputError(f"no integration {method!r}; choose from {', '.join(METHODS)}.")
    module, name = METHODS[method].split(":")
    cls = getattr(import_module(module), name)
    if unknown := sorted(set(options) - set(cls.__dataclass_fields__)):
        known = ", ".join(cls.__dataclass_fields__) or "none"
        raise InputError(f"{method} has no option {unknown[0]!r}; it has {known}.")
    return cls(**options)


def integrate(normals: Normals, method: str = DEFAULT, K: np.ndarray | None = None, **options: Any) -> Surface:
    """The surface that has these normals.

    Parameters
    ----------
    normals : unit normals and their mask, which may have several parts and holes
    method : a key of METHODS
    K : (3, 3) camera matrix in pixels of the normal map (x right, y down), for a perspective view; None: orthographic
    options : the method's fields, by name

    Returns
    -------
    Heights towards the camera in pixels, zero on average in each connected part; with `K`, distances along the optical
    axis whose logarithm is zero on average in each part: normals alone do not tell how far away a part is.

    Raises
    ------
    InputError
        If the method or an option does not exist, `K` is no camera matrix, or no pixel has a normal.
    """
    solver = configure(method, **options)
    if K is not None and (np.shape(K) != (3, 3) or not np.isfinite(K).all() or not (K[0, 0] > 0 and K[1, 1] > 0)):
        raise InputError(
            f"the camera matrix is {np.shape(K)} but 3 x 3 finite numbers with positive focal lengths are needed; "
            "give fx 0 cx, 0 fy cy, 0 0 1 in pixels."
        )
    if not normals.mask.any():
        raise InputError("no pixel has a normal but integration needs some; check the mask.")
    return solver(normals, K)
