"""Capture -> what is wrong with it, before anyone measures it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from photonormal.check.finding import Finding
    from photonormal.types import Capture


def check(capture: Capture) -> list[Finding]:
    """Everything that may spoil the normals of a capture, grave findings first; an empty list where nothing was found.

    Saturation, darkness, bits and encoding, coverage by the lights, lamps' positions, lights in another order or frame,
    intensities, ambient light and motion. Tests that need light directions are left out where they are unknown. Where
    lamps are near, pictures are first made what distant ones would give, for a plane at the object's mean depth.
    """
    from photonormal.check import coverage, exposure, lights, motion, positions, samples
    from photonormal.check.given import Distant, Near

    s, names = samples.read(capture), list(capture.image_names)
    found = [*exposure.saturation(s, capture), *exposure.darkness(s, capture), *exposure.bits(s, capture)]
    expected = None
    if capture.lights is not None and (s.I > 0).any():
        found += coverage.coverage(capture.lights)
        I, mask = samples.on_object(s)
        if capture.lamps is not None and capture.camera is not None:
            X = capture.camera.plane_mm(*capture.mask.shape)[s.grid][mask]
            given = Near(I, X, capture.lamps)
            found += positions.positions(given, names)
        else:
            given = Distant(I, capture.lights)
        lost = (given.levels > 0).any(axis=0) > (given.seen() > 0).any(axis=0)  # by lamps that shine elsewhere
        if not lost.any():
            wrong, given = lights.disagreement(given, mask, names)
            seen, L = given.seen(), given.directions()  # what else is said of the lights holds for the right ones
            found += [*wrong, *lights.intensities(seen, L, names), *lights.ambient(seen, L)]
            found += exposure.encoding(given, s.bits)
        if isinstance(given, Near):
            expected = samples.expected_edges(s, given.lamps)
    found += motion.motion(s.edges, s.scale, names, expected)
    return sorted(found, key=lambda f: not f.grave)
