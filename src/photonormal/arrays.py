"""Arrays as people have them, made what `photonormal.types` promises, or refused in one line."""

from __future__ import annotations

from typing import Any

import numpy as np

from photonormal.errors import InputError

UNITS = 1e-6, 1e12  # of the brightest sample, in which single precision holds what is made of squares of samples


def as_array(value: Any, what: str) -> np.ndarray:
    """Numbers in an array; InputError where there is none."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows, or pictures, of several sizes
        raise InputError(f"{what} have several sizes but one array is needed; cut them to one size.") from None
    except (TypeError, RuntimeError) as error:  # such as a tensor on a GPU
        line = str(error).strip().splitlines()[0][:200]
        raise InputError(f"{what} are {type(value).__name__} ({line}) but an array is needed; make one.") from None
    if array.dtype.kind not in "buif":
        raise InputError(f"{what} are {type(value).__name__} of {array.dtype} but numbers are needed; give an array.")
    return array


def as_images(value: Any) -> tuple[Any, np.ndarray | None]:
    """Pictures (n, h, w, c) float32, full scale at 1 if they are integers; what decodes them one by one stays.

    What is no number becomes 0, which is dark; what is infinite becomes the brightest sample. Where that was, (h, w),
    comes second; None where all is finite.
    """
    if not (isinstance(value, list | tuple) or hasattr(value, "__array__")):
        if hasattr(value, "shape") and hasattr(value, "__getitem__"):
            return value, None
        raise InputError(
            f"images are {type(value).__name__} but an array (n, h, w, 1 or 3) is needed; photonormal.load reads files."
        )
    images = as_array(value, "images")
    if images.dtype.kind in "bi" or (images.dtype.itemsize > 2 and images.dtype.kind == "u"):
        raise InputError(
            f"images are {images.dtype}, whose full scale is not known, but uint8, uint16 or floats are needed; divide "
            "them by it, such as images / 4095."
        )
    full = float(np.iinfo(images.dtype).max) if images.dtype.kind == "u" else 1.0
    with np.errstate(over="ignore"):
        images = images.astype(np.float32) / np.float32(full) if full > 1 else images.astype(np.float32, copy=False)
    if images.ndim == 3 and images.shape[-1] > 0:  # grey
        images = images[..., None]
    known = np.isfinite(images)
    if images.ndim != 4 or known.all():
        return images, None
    images = np.nan_to_num(images, nan=0, posinf=images.max(where=known, initial=0), neginf=0)
    return images, np.asarray(~known.all(axis=(0, 3)))


def unit_of(images: Any, mask: np.ndarray) -> float:
    """What pictures are to be divided by: 1, or in an array whose samples are beyond UNITS the mask's brightest."""
    least, most = UNITS
    if not isinstance(images, np.ndarray) or least <= images.max() <= most:
        return 1.0
    brightest = float(images.max(where=mask[..., None], initial=0))
    return 1.0 if least <= brightest <= most or brightest == 0 else brightest


def as_mask(value: Any, shape: tuple[int, int]) -> np.ndarray:
    """Where the object is, bool (h, w): what is brighter than half of the brightest; None is everywhere."""
    if value is None:
        return np.ones(shape, bool)
    mask = as_array(value, "the mask")
    if mask.dtype == bool or mask.shape != shape:
        return mask
    return mask > 0.5 * mask.max()
