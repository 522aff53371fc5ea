"""Lights that nobody measured, or measured badly: from the photographs of the object itself."""

from __future__ import annotations

from photonormal.lighting import FoundLights
from photonormal.options import LightsFrom
from photonormal.types import Capture


def found_lights(capture: Capture, how: LightsFrom) -> FoundLights:
    """The distant lights of a capture: its own ones, mended ("refined").

    Raises
    ------
    InputError
        If lights can't be found from these photographs.
    """
    from photonormal.methods.uncalibrated.refine import refined

    return refined(capture)
