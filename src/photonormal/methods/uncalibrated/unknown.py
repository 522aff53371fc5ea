"""Lights of which nothing is known: a network gives them, then lights and normals refine each other."""

from __future__ import annotations

import torch

from photonormal.lighting import FoundLights
from photonormal.methods.learned.weights import LIGHTS, load_network, shipped
from photonormal.methods.uncalibrated.frame import Believed
from photonormal.methods.uncalibrated.guess import guess
from photonormal.methods.uncalibrated.limits import check_findable, refuse_narrow, spread_deg
from photonormal.methods.uncalibrated.rounds import rounds
from photonormal.methods.uncalibrated.shown import ShownPixels
from photonormal.methods.uncalibrated.untold import leaning, off_by, shape_of_lights, side_of_lights
from photonormal.progress import progress
from photonormal.shading import angle_deg, normalised
from photonormal.types import Capture, InputError

INDEPENDENT = 3.0  # of the network's errors, most of which all lights of an object share
SHADED = 0.02  # second singular value of the samples over the first, below which nothing but brightness differs
NARROW_DEG = 7.0  # of lights, in the direction in which they differ least, below which normals are uncertain
TINTED = 0.2  # of a channel over grey, from which on lights differ in colour
REFINED_OFF, GUESS_OFF = 0.3, 0.6  # error of lights over the breadth of the network's answer, median of rendered ones
STILL_DEG = 0.25  # mean change of the lights in the last round, from which on shading does not bear them out
FAR_OFF = 1.5  # and times the breadth of the network's answer, from which on neither
BROAD_DEG = 20.0  # of the network's answer, from which on it is doubtful


def unknown_lights(capture: Capture, device: torch.device) -> FoundLights:
    """Directions and intensities of a capture's distant lights from its photographs alone.

    Raises
    ------
    InputError
        If there are too few photographs, they differ in nothing but brightness, or their lights are all in about one
        plane or direction.
    """
    check_findable(capture)
    with progress("lights"):
        shown = ShownPixels.of(capture)
        refuse_unshaded(shown, capture.name)
        first = guess(load_network(shipped(LIGHTS), "lightsnet"), capture, device)
        start = first.lights * first.intensities[:, None]
        off = GUESS_OFF * float(first.told_deg.mean().deg2rad())
        believed = Believed(first.lights, INDEPENDENT, first.intensities, off=off)
        s, N, moved_deg = rounds(shown, start, believed, unknown=True)
    apart_deg = float(angle_deg(normalised(s), first.lights).mean())
    settled = moved_deg < STILL_DEG and apart_deg < FAR_OFF * float(first.told_deg.mean())
    if not settled:
        s = start
    lights, intensities = normalised(s.double()), s.double().norm(dim=1)
    refuse_narrow(lights, capture.name)
    narrow = spread_deg(lights)
    alone = "" if settled else " by the network alone: the shading does not agree, as on metal, and they are uncertain"
    off_deg = float(first.told_deg.mean()) * (REFINED_OFF if settled else GUESS_OFF)
    outwards = leaning(N, shown.inside)
    notes = [f"the lights were found from the photographs alone{alone}; {off_by(off_deg, outwards)}."]
    if doubtful := float(first.told_deg.mean()) > BROAD_DEG:
        notes.append(
            "The lights' directions are doubtful: a bulge may be a hollow, and relief too deep or too flat; "
            "compare the result with the object."
        )
    notes += shape_of_lights(N, shown.inside)
    if not doubtful:
        notes += side_of_lights(outwards)
    if tint(shown) > TINTED:
        notes.append(
            "The lights differ in colour, but only one intensity of each was found, so the albedo's colours are wrong."
        )
    if narrow < NARROW_DEG:
        notes.append(f"The lights differ by {narrow:.0f} degrees only, so relief may be much too deep or too flat.")
    return FoundLights(lights.numpy(), (intensities / intensities.mean()).numpy(), notes=tuple(notes))


def tint(shown: ShownPixels) -> float:
    """How much the colour of the images differs: the largest standard deviation of a channel's logarithm over grey."""
    log = shown.colours.clamp(min=1e-6).log()
    return float((log - log.mean(1, keepdim=True)).std(0).max())


def refuse_unshaded(shown: ShownPixels, name: str) -> None:
    """InputError where pictures differ in nothing but brightness, so that they show neither shape nor lights."""
    values = torch.linalg.svdvals((shown.I.T @ shown.I).double()).sqrt()
    if len(shown.I) < 50 or not values[1] > SHADED * values[0]:
        raise InputError(
            f"the photographs of {name} show no lights: shading is the same in all of them; give photographs of a "
            "curved object under different lights, or give the lights."
        )
