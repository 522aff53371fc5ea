"""What photographs leave open where lights are found from them: other lights explain them with another surface."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.uncalibrated.frame import as_grid, curl_of
from photonormal.methods.uncalibrated.limits import spread_deg
from photonormal.outline import Outline

CURVED_DEG = 2.0  # of normals, below which a surface is bent in one direction at most
IRREGULAR = 0.005  # least curl that a change of the lights makes, mean square, over what it is made of
OUTWARDS = 0.5  # median of n.o along an outline where the surface turns away, o pointing outwards in the picture
WHOLE = 0.75  # the same of objects that are seen whole, whose lights a network gives; of reliefs it is less
FLAT = (
    "The surface is nearly flat, or bent in one direction at most, like a cylinder, so the other direction of each "
    "light is uncertain."
)
REGULAR = (
    "The surface is too regular, as a cylinder, a saddle, a few flat sides or a low relief are: other lights, with "
    "another surface, would give the same photographs; compare the result with the object."
)
HOLLOW = (
    "Most of the outline is not where the surface turns away from the camera, so a bulge looks like a "
    "hollow that is lit from the opposite side; compare the result with the object."
)

BULGE = "The object was assumed to bulge; a hollow, such as a bowl, comes out inside out."


def shape_of_lights(N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"]) -> tuple[str, ...]:
    """What can't be known of lights where the normals that were found are those of such a surface."""
    if not spread_deg(N[N.norm(dim=1) > 0.5]) > CURVED_DEG:
        return (FLAT,)
    evidence = curl_of(N, inside)
    if evidence is None:
        return ()
    return () if float(torch.linalg.eigvalsh(evidence.power())[0]) > IRREGULAR else (REGULAR,)


def leaning(N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"]) -> float:
    """How far normals along the outline point outwards, 1 where the surface turns away; 0 where the frame cuts it."""
    outline = Outline.of(as_grid(N, inside).numpy(), inside.numpy())
    return 0.0 if outline is None else float(np.median((outline.n[:, :2] * outline.away).sum(-1)))


def side_of_lights(outwards: float) -> tuple[str, ...]:
    """What is known of bulge or hollow: no matt shading, highlight or shadow of a surface on itself shows them, only an
    outline where it turns away from the camera, which is that of a bulge, or of a bowl that is seen up to its rim.
    `outwards` is the `leaning`."""
    return (BULGE,) if outwards > OUTWARDS else (HOLLOW,)


def off_by(off_deg: float, outwards: float) -> str:
    """How far lights are off as a rule, where the outline is that of an object seen whole; else that none can say."""
    if outwards > WHOLE:
        return (
            f"about {off_deg:.0f} degrees off, at times three times that, if the object is seen whole, to where its "
            "surface turns away from the camera; for a sherd or another domed part they may be off by 25"
        )
    return (
        "how far they are off is not known, since the surface does not turn away from the camera along the outline: "
        "for coins, plates, tablets and cloth it was more than 30 degrees as a rule, for objects without a mask 2 to "
        "34; give a mask of the whole object, or give the lights"
    )
