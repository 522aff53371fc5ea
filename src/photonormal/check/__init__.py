"""Capture -> what is wrong with it, before anyone measures it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from photonormal.check.finding import Finding
    from photonormal.types import Capture


def check(capture: Capture) -> list[Finding]:
    """Everything that may spoil the normals of a capture, grave findings first; an empty list where nothing was found.

    Saturation, darkness, bits and encoding, coverage by the lights, lights in another order or frame, intensities,
    ambient light and motion. Tests that need light directions are left out where they are unknown, and all of them but
    coverage where lamps are near, since they know distant lights.
    """
    from photonormal.check import coverage, exposure, lights, motion, samples

    s, names = samples.read(capture), list(capture.image_names)
    found = [*exposure.saturation(s, capture), *exposure.darkness(s, capture), *exposure.bits(s, capture)]
    found += motion.motion(s.edges, s.scale, names)
    if capture.lights is not None and (s.I > 0).any():
        found += coverage.coverage(capture.lights)
    if capture.lights is not None and capture.lamps is None and (s.I > 0).any():
        L, (I, mask) = capture.lights, samples.on_object(s)
        wrong = lights.disagreement(I, mask, L, names)
        found += wrong
        if wrong and wrong[0].lights is not None:
            L = wrong[0].lights  # what is to be said of the lights holds for the right ones
        found += [*lights.intensities(I, L, names), *lights.ambient(I, L), *exposure.encoding(I, s.bits, L)]
    return sorted(found, key=lambda f: not f.grave)
