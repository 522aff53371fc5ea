"""Pictures, and lights of pixels, that are read or computed when they are asked for, in parts where they can be."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

Image = Float[np.ndarray, "h w c"]  # linear radiance / light intensity, float32


@runtime_checkable
class Images(Protocol):
    """`n` pictures of one size, read one at a time: a float32 array (n, h, w, c), or files decoded when asked for.

    Those that can read a part of one alone have ``window(j, rows, columns)``, which `window_of` asks; `rows` may be
    every second or third of them. Those whose samples were changed after the sensor cut them off show by
    ``saturated(j, rows, columns)`` where it did, as `Capture.saturated` does; None: by their level alone.
    """

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, index: int, /) -> np.ndarray: ...


def window_of(images: Images, j: int, rows: slice, columns: slice) -> Image:
    """A part of one picture, without more of it being read where the images can do so."""
    read = getattr(images, "window", None)
    return images[j][rows, columns] if read is None else read(j, rows, columns)


def saturated_in(images: Images, j: int, rows: slice, columns: slice) -> Bool[np.ndarray, "h w c"] | None:
    """Where the images say that a part of one is saturated; None where they don't say it."""
    known = getattr(images, "saturated", None)
    return None if known is None else known(j, rows, columns)


@runtime_checkable
class LightsAt(Protocol):
    """Unit vectors to the lights from the mask's pixels: an array (p, n, 3), or computed for the pixels asked for."""

    def __getitem__(self, pixels: Any, /) -> np.ndarray: ...
