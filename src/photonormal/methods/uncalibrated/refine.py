"""Lights that are known badly, mended by what the photographs show under them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.geometry import angle_deg
from photonormal.lighting import FoundLights
from photonormal.methods.uncalibrated.frame import Believed, curl
from photonormal.methods.uncalibrated.limits import LEAST, check_findable
from photonormal.methods.uncalibrated.rounds import SETTLED_DEG, misfit, normals_under, rounds
from photonormal.methods.uncalibrated.shown import ShownPixels
from photonormal.methods.uncalibrated.untold import shape_of_lights
from photonormal.progress import progress
from photonormal.resources import by_one_thread
from photonormal.types import Capture, InputError

TURNED = 0.2  # standard deviation of a turn of all given lights about the view axis, radians
UNEVEN = 0.05  # unevenness of lights that were divided by their intensities, from which on they may be halfway vectors
EVENER = 0.7  # and are, where twice the angles leave less than this of it
HALFWAY = (
    "the given lights were halfway to the right ones; their angles to the camera's axis were doubled, then corrected."
)
ALRIGHT = "no other lights fit the photographs better than the given ones, so these are kept."
UNTOLD = (
    "no lights agree with the shading, as on metal or in much noise, so nothing shows whether the given lights are "
    "right; they are kept."
)


@dataclass(frozen=True)
class Proof:
    """What must be true of mended lights before the given ones are given up.

    Parameters
    ----------
    uneven : unevenness below it; above, shading agrees with no lights, as on metal or under a broad sheen
    misfit : at most this part of the misfit under the given lights is left
    less_curl : of the normals, by which mended lights are taken, too: a turn of all lights changes no misfit
    moved_deg : they move by as much in the mean; those that move by less are not looked at further
    turned_deg : and by as much where only the curl speaks for them
    halfway : twice the angles to the camera's axis are tried, too
    """

    uneven: float
    misfit: float
    less_curl: float
    moved_deg: float
    turned_deg: float
    halfway: bool


# A broad sheen on a flat relief moves right lights by 2 to 4 degrees, unevenly, and takes a curl of 6 to 39 of weaves;
# a turn of all by 8 degrees makes one of 17 and more that mended ones lack. Twice the angles mimic the sheen of a plate
# under narrow lights, and the doctor has more proofs of halfway ones.
ASKED = Proof(uneven=0.2, misfit=0.98, less_curl=6.0, moved_deg=0.0, turned_deg=0.0, halfway=True)
UNASKED = Proof(uneven=0.08, misfit=0.6, less_curl=16.0, moved_deg=1.5, turned_deg=3.0, halfway=False)


@by_one_thread()
def refined(capture: Capture, proof: Proof = ASKED) -> FoundLights:
    """The capture's own distant lights, mended: each is turned to where the photographs speak for.

    Their errors are to be each light's own: what all have in common is found where the normals' curl shows it, and is
    believed else. Intensities stay as they are, so lights that are found have one length; where they haven't, and
    have it nearly when they start at twice the angle to the camera's axis, the given ones were halfway to the right
    ones: a mirror sphere's normals in place of the reflections there. Lights are kept where there is no `proof`.

    Raises
    ------
    InputError
        If there are no lights, they are near, or there are too few photographs.
    """
    L = torch.from_numpy(capture.known_lights()).float()
    check_findable(capture)
    with progress("lights"):
        shown = ShownPixels.of(capture)
        s, N, moved_deg = rounds(shown, L, given(L))
        halfway = False
        if proof.halfway and unevenness(s) > UNEVEN:
            twice = reflected(L)
            other = rounds(shown, twice, given(twice))
            if halfway := unevenness(other[0]) < EVENER * unevenness(s):
                s, N, moved_deg = other
        found = torch.nn.functional.normalize(s.double(), dim=1).numpy()
        off_deg = angle_deg(found, capture.known_lights())
        told = moved_deg < SETTLED_DEG and unevenness(s) < proof.uneven
        better = False
        if told and off_deg.mean() >= proof.moved_deg:
            N_given = normals_under(shown, L)
            better = misfit(shown, N, s) < proof.misfit * misfit(shown, N_given, L)
            if not better and off_deg.mean() >= proof.turned_deg:
                better = bent(shown, N) < bent(shown, N_given) - proof.less_curl
    if not better:
        note = ALRIGHT if told else UNTOLD
        return FoundLights(capture.known_lights(), moved_deg=np.zeros(len(L)), notes=(note,))
    return FoundLights(found, moved_deg=off_deg, notes=(HALFWAY,) * halfway + shape_of_lights(N, shown.inside))


def bent(shown: ShownPixels, N: Float[Tensor, "p 3"]) -> float:
    """How clearly the curl of N's slopes speaks for other normals: the square of standard errors; 0 where it can't."""
    evidence = curl(N, shown.inside)
    return 0.0 if evidence is None else float(evidence.told @ evidence.precision @ evidence.told)


def given(L: Float[Tensor, "n 3"]) -> Believed:
    """Lights whose errors are each their own, and by whose intensities the pictures were divided."""
    return Believed(L, float(len(L)), torch.ones(len(L)), TURNED)


def reflected(N: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    """Where light comes from that a mirror of these normals sends to the camera: at twice their angle to its axis."""
    return 2 * N[:, 2:] * N - N.new_tensor([0.0, 0.0, 1.0])


def unevenness(s: Float[Tensor, "n 3"]) -> float:
    """How much the lengths of lights differ: the standard deviation of their logarithms."""
    return float(s.norm(dim=1).log().std())


def mended(capture: Capture) -> FoundLights | None:
    """The capture's lights as `refined` has them, where the photographs prove that it must move them; else None.

    Right lights of real objects move by 0.2 to 0.5 degrees in the mean, ones that are 2 degrees off by 2.
    """
    if capture.lights is None or capture.lamps is not None or capture.images.shape[0] < LEAST:
        return None
    try:
        found = refined(capture, UNASKED)
    except InputError:  # a strip, of which too little is seen
        return None
    assert found.moved_deg is not None
    return found if found.moved_deg.any() else None
