"""Lights as an array of NumPy (`.npy`, `.npz`) or MATLAB (`.mat`): (n, 3) or (3, n)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from photonormal.capture.lights.table import LightTable
from photonormal.files.matlab import read_mat, shapes_of
from photonormal.files.opening import TEXT, open_file, read_array, read_npz, reason_of, size_of
from photonormal.types import InputError

CALLED = ("s", "l", "lights", "light", "light_directions", "directions", "lightdirections", "l_dir", "light_dir")


def read(path: Path) -> LightTable:
    """The array, a light in each row."""
    kind, variable = path.suffix.lower(), None
    if kind == ".npy":
        array = _npy(path)
    elif kind == ".npz":
        arrays = read_npz(path, "save the lights as an (n, 3) array", at_most=TEXT)
        variable = _variable({name: a.shape for name, a in arrays.items()}, path)
        array = arrays[variable]
    else:
        variable = _variable(shapes_of(path), path)
        array = read_mat(path, variable)
    notes = () if variable is None else (f"{path.name}: the lights are its array {variable}.",)
    if array.ndim != 2 or not array.size or array.dtype.kind not in "iuf":
        raise InputError(f"{path} holds {array.dtype} {array.shape} but (n, 3) numbers are needed; save the lights so.")
    return LightTable([], array.astype(np.float64), notes=notes)


def _npy(path: Path) -> np.ndarray:
    try:
        with open_file(path) as file:
            if size_of(file) > TEXT:
                raise ValueError(f"it has {size_of(file)} bytes, too many for lights")
            return read_array(file, size_of(file))
    except FileNotFoundError:
        raise InputError(f"{path} is missing but it is needed; restore it or name another.") from None
    except Exception as error:  # damaged headers raise anything
        raise InputError(f"{path} can't be read ({reason_of(error)}); save the lights as an (n, 3) array.") from None


def _variable(shapes: Mapping[str, tuple[int, ...]], path: Path) -> str:
    """The array with lights: the only one that can be, or the only one with a name that says so."""
    fits = [n for n, shape in shapes.items() if len(shape) == 2 and 3 in shape and max(shape) >= 3]
    chosen = fits if len(fits) == 1 else [n for n in fits if n.lower() in CALLED]
    if len(chosen) != 1:
        raise InputError(
            f"{path} holds {', '.join(fits) or 'no array'} of (n, 3) but one with the lights is needed; save them "
            "alone, as S."
        )
    return chosen[0]
