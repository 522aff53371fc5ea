"""Lights that never change: which of a rig's lamps each photograph shows."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from photonormal.shading import angle_deg
from photonormal.types import InputError

OFF_DEG = 3.0  # by which a light may be measured elsewhere than it was in training


def lamps_of(L: Float[Tensor, "*p k 3"], rig: Float[Tensor, "n 3"]) -> Int[Tensor, " n"]:
    """Numbers of the rig's lamps that unit lights are, each once.

    Raises
    ------
    InputError
        If there are not as many, or a light is farther than OFF_DEG from its lamp, as any pixel sees it; the farthest
        is named, counted from 1 in the order of the photographs.
    """
    n = L.shape[-2]
    if n != len(rig):
        raise InputError(
            f"{n} lights came but this network learned for a rig of {len(rig)}; give all its photographs, or train one "
            "for yours: photonormal train dpsn --lights FILE."
        )
    L = L.reshape(-1, n, 3).double()
    mean = torch.nn.functional.normalize(L.mean(0), dim=-1)
    rig = rig.to(L)
    lamps = (mean @ rig.T).argmax(1)
    if len(lamps.unique()) < n:
        lamps = torch.from_numpy(linear_sum_assignment(-(mean @ rig.T).cpu().numpy())[1]).to(L.device)
    off = angle_deg(L.flatten(0, 1), rig[lamps].repeat(len(L), 1)).view(-1, n).amax(0)  # (n,)
    if off.max() > OFF_DEG:
        raise InputError(
            f"light {int(off.argmax()) + 1} is {float(off.max()):.1f} degrees from where this network learned it but "
            f"at most {OFF_DEG:g} are possible; train one for your rig: photonormal train dpsn --lights FILE."
        )
    return lamps
