"""Capture -> what is wrong with it, before anyone measures it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from photonormal.doctor.finding import Finding

if TYPE_CHECKING:
    from photonormal.types import Capture


def findings_of(capture: Capture) -> list[Finding]:
    """Everything that may spoil the normals of a capture, grave findings first; an empty list where nothing was found.

    What was assumed on reading, saturation, darkness, bits and encoding, coverage by the lights, lamps' positions,
    lights in another order or frame, pictures of the same light, intensities, ambient light, and pictures that are
    turned or shifted. Tests that need light directions are left out where they are unknown, or where pictures are
    turned. Where lamps are near, pictures are first made what distant ones would give, for a plane at the object's mean
    depth.
    """
    from photonormal.doctor import (
        coverage,
        explanations,
        exposure,
        lights,
        motion,
        positions,
        repeated,
        samples,
        turned,
    )
    from photonormal.doctor.given import Distant, Near
    from photonormal.srgb import from_linear, to_linear
    from photonormal.types import as_capture

    capture = as_capture(capture)
    s, names = samples.read(capture), list(capture.image_names)
    found: list[Finding] = []
    asked = {"--exif-exposure": {"exif_exposure": True}}
    if capture.likely_encoded:
        asked["--srgb"] = {"srgb": True, "linear": False}
    for note in capture.notes:
        found.append(Finding("reading", False, note, options=next((asked[o] for o in asked if o in note), {})))
    if swapped := samples.inverted(capture.mask, s):
        return [*swapped, *found]  # all else would be judged of the ground
    I, mask = samples.on_object(s)
    white = exposure.saturation(s, capture)
    found += [*white, *exposure.darkness(I, names), *exposure.bits(s, I, capture), *samples.no_mask(s.mask, mask)]
    height, width = capture.mask.shape
    if lie_otherwise := turned.turned(s.small, s.middle, height == width, names):
        return sorted([*found, *lie_otherwise], key=lambda f: not f.grave)
    if capture.lights is not None and (s.I > 0).any():
        found += coverage.coverage(capture.lights)
        if capture.lamps is not None and capture.camera is not None:
            X = capture.camera.plane_mm(*capture.mask.shape)[s.grid][mask]
            given = Near(I, X, capture.lamps)
            found += positions.positions(given, names)
        else:
            given = Distant(I, capture.lights)
        lost = (given.levels > 0).any(axis=0) > (given.seen() > 0).any(axis=0)  # by lamps that shine elsewhere
        if not lost.any():
            cut = any(f.grave for f in white)  # samples that are white look as if other light was on
            linearised, encoded = capture.linearised, capture.likely_encoded
            other = [] if cut else explanations.explanation(given, mask, s.bits, linearised, encoded)
            if other and other[0].lights is not None:
                given = Distant(I, other[0].lights)
            if other and other[0].kind == "encoding":
                change = from_linear if capture.linearised else to_linear
                given = given.showing(change(given.levels / given.levels.max()))
            wrong, better = lights.disagreement(given, mask, names)
            changed = bool(other) or cut  # brightnesses, by themselves
            known = not wrong or better is not given  # lights that fit
            twice = repeated.repeated(better, mask, names) if known and not changed else []
            if twice:  # which no order of the lights mends
                wrong = [f for f in wrong if f.kind != "order"]
            found += [*wrong, *other, *twice]
            if not changed and not twice:
                found += lights.intensities(better, mask, names)
    found += motion.motion(s.small, s.scale, names)
    return sorted(found, key=lambda f: not f.grave)
