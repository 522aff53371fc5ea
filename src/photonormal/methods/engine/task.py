"""What a network is asked for: all windows and passes of a measurement share it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from photonormal.methods.engine.prior import FirstLook
from photonormal.methods.engine.windows import Box
from photonormal.types import Capture


@dataclass(frozen=True)
class Task:
    """The normals of a capture's box.

    Parameters
    ----------
    rotations : quarter turns of the images that are averaged over
    passes : how often the network looks
    band : rows that are looked at together by a network that sees pixels by themselves
    advance : is called with how many samples were looked at
    """

    capture: Capture
    box: Box
    look: FirstLook
    device: torch.device
    rotations: int
    passes: int
    band: int
    advance: Callable[[int], None]
