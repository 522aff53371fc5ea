"""Which photographs tell lights, and under which lights normals can be found."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.types import Capture, InputError

LEAST = 6  # photographs; of fewer any lights explain nearly everything
SPREAD_DEG = 4.0  # of lights, in the direction in which they differ least, below which normals can't be found


def check(capture: Capture) -> None:
    """InputError where lights can't be found from the photographs."""
    n = capture.images.shape[0]
    if capture.lamps is not None:
        raise InputError(
            f"{capture.name} has near lights but only distant ones can be found from its photographs; leave "
            "--mm-per-px and files of positions out, or measure with the given ones."
        )
    if n < LEAST:
        raise InputError(f"{n} images came but {LEAST} or more are needed to find lights from; add photographs.")


def spread_deg(L: Float[Tensor, "n 3"], name: str) -> float:
    """How far lights that were found are off a plane through the surface, root mean square, in degrees.

    Raises
    ------
    InputError
        If that is too little to find normals.
    """
    narrow = float(torch.rad2deg(torch.asin((torch.linalg.svdvals(L)[-1] / len(L) ** 0.5).clamp(max=1))))
    if not narrow > SPREAD_DEG:
        raise InputError(
            f"the photographs of {name} seem to be lit from about one plane or direction (lights differ by "
            f"{narrow:.0f} degrees across it) and can't be measured; add photographs with the light from elsewhere, "
            "or give the lights."
        )
    return narrow
