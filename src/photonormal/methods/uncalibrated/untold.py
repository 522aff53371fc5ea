"""What photographs leave open where lights are found from them: other lights explain them with another surface."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.uncalibrated.frame import curl_of, on_map
from photonormal.methods.uncalibrated.limits import spread_deg

CURVED_DEG = 2.0  # of normals, below which a surface is bent in one direction at most
IRREGULAR = 0.005  # least curl that a change of the lights makes, mean square, over what it is made of
OUTWARDS = 0.5  # median of n.o along an outline where the surface turns away, o pointing outwards in the picture
RIM, SMOOTH = 2, 2.0  # pixels inside the outline, and over which its direction is found
FLAT = (
    "The surface is bent in one direction at most, like a cylinder, so the other direction of each light is uncertain."
)
REGULAR = (
    "The surface is too regular, as a cylinder, a saddle or a few flat sides are: other lights, with another surface, "
    "would give the same photographs; compare the result with the object."
)
HOLLOW = (
    "Most of the outline is not where the surface turns away from the camera, so photographs don't tell a bulge from a "
    "hollow that is lit from the opposite side; compare the result with the object."
)


def shape_of_lights(N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"]) -> tuple[str, ...]:
    """What can't be told of lights where the normals that were found are those of such a surface."""
    if not spread_deg(N[N.norm(dim=1) > 0.5]) > CURVED_DEG:
        return (FLAT,)
    told = curl_of(N, inside)
    if told is None:
        return ()
    J = told.J * told.weight[:, None]
    return () if float(torch.linalg.eigvalsh(J.T @ J / len(J))[0]) > IRREGULAR else (REGULAR,)


def side_of_lights(N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"]) -> tuple[str, ...]:
    """Whether a bulge can't be told from a hollow: no matt shading, highlight or shadow of a surface on itself does,
    only an outline where it turns away from the camera, which is that of a bulge."""
    mask = np.pad(inside.numpy().astype(np.float32), 2 * RIM)
    down, right = np.gradient(cv2.GaussianBlur(mask, (0, 0), SMOOTH))
    out = np.stack([-right, down], axis=-1)  # x right, y up
    out /= np.linalg.norm(out, axis=-1, keepdims=True).clip(1e-9)
    inner = cv2.erode(mask, np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8))
    map = np.pad(on_map(N, inside).numpy(), ((2 * RIM,) * 2, (2 * RIM,) * 2, (0, 0)))
    rim = (mask > 0) & (inner == 0) & (np.linalg.norm(map, axis=-1) > 0.5)
    leaning = (map[..., :2] * out).sum(-1)[rim]
    return () if leaning.size and float(np.median(leaning)) > OUTWARDS else (HOLLOW,)
