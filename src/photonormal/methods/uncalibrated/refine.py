"""Lights that are known badly, mended by what the photographs show under them."""

from __future__ import annotations

import numpy as np
import torch

from photonormal.geometry import angle_deg
from photonormal.lighting import FoundLights
from photonormal.methods.uncalibrated.frame import Believed
from photonormal.methods.uncalibrated.rounds import misfit, normals_under, rounds
from photonormal.methods.uncalibrated.shown import Shown
from photonormal.progress import progress
from photonormal.types import Capture, InputError

LEAST = 6  # photographs; of fewer any lights explain nearly everything
BETTER = 0.98  # of the misfit under the given lights: mended ones that leave more are not taken


def refined(capture: Capture) -> FoundLights:
    """The capture's own distant lights, mended: each is turned to where the photographs speak for.

    Their errors are to be each light's own: what all have in common is told where the normals' curl tells it, and is
    believed else. Intensities stay as they are.

    Raises
    ------
    InputError
        If there are no lights, they are near, or there are too few photographs.
    """
    L = torch.from_numpy(capture.known_lights()).float()
    check(capture)
    with progress("lights"):
        shown = Shown.of(capture)
        s, N, moved_deg = rounds(shown, L, Believed(L, float(len(L))))
        before, after = misfit(shown, normals_under(shown, L), L), misfit(shown, N, s)
    if not after < BETTER * before:
        note = "the photographs speak for no other lights than the given ones, which are kept."
        return FoundLights(capture.known_lights(), moved_deg=np.zeros(len(L)), notes=(note,))
    found = torch.nn.functional.normalize(s.double(), dim=1).numpy()
    notes = () if moved_deg < 1 else ("lights and normals did not settle; check the given lights' order and frame.",)
    return FoundLights(found, moved_deg=angle_deg(found, capture.known_lights()), notes=notes)


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
