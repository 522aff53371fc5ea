"""Lights that nobody measured, or measured badly: from the photographs of the object itself."""

from __future__ import annotations

from photonormal.lighting import FoundLights
from photonormal.options import LightsFrom
from photonormal.types import Capture


def found_lights(capture: Capture, how: LightsFrom, device: str = "auto") -> FoundLights:
    """The distant lights of a capture: its own ones, mended ("refined"), or from its photographs alone ("unknown").

    Raises
    ------
    InputError
        If lights can't be found from these photographs.
    """
    if how == "refined":
        from photonormal.methods.uncalibrated.refine import refined

        return refined(capture)
    from photonormal.methods.engine.device import torch_device
    from photonormal.methods.uncalibrated.unknown import unknown_lights

    return unknown_lights(capture, torch_device(device))
