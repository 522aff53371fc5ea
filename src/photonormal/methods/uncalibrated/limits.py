"""Which photographs show lights, and under which lights normals can be found."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.methods.engine.looks import refuse_huge
from photonormal.types import Capture, InputError

LEAST = 6  # photographs; of fewer any lights explain nearly everything
SPREAD_DEG = 4.0  # of lights, in the direction in which they differ least, below which normals can't be found


def check_findable(capture: Capture) -> None:
    """InputError where lights can't be found from the photographs."""
    n = capture.images.shape[0]
    refuse_huge(capture)
    if capture.lamps is not None:
        raise InputError(
            f"{capture.name} has near lights but only distant ones can be found from its photographs; leave "
            "--mm-per-px and files of positions out, or measure with the given ones."
        )
    if n < LEAST:
        raise InputError(f"{n} images came but {LEAST} or more are needed to find lights from; add photographs.")


def refuse_narrow(L: Float[Tensor, "n 3"], name: str) -> None:
    """InputError where lights that were found differ too little to find normals under them."""
    narrow = spread_deg(L)
    if not narrow > SPREAD_DEG:
        raise InputError(
            f"the photographs of {name} seem to be lit from about one plane or direction, or to show a surface that is "
            f"bent in one direction only (lights differ by {narrow:.0f} degrees across it), and can't be measured; add "
            "photographs with the light from elsewhere, or give the lights."
        )


def spread_deg(vectors: Float[Tensor, "n 3"]) -> float:
    """How far unit vectors are off the plane through the origin that fits them best, root mean square, degrees."""
    least = torch.linalg.eigvalsh((vectors.T @ vectors).double() / max(len(vectors), 1))[0].clamp(0, 1)
    return float(torch.rad2deg(torch.asin(least.sqrt())))
