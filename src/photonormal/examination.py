"""What is wrong with a capture, as `check` and `measure` say it: the doctor's findings, and lights to be mended."""

from __future__ import annotations

from photonormal.doctor import findings_of
from photonormal.doctor.finding import Finding
from photonormal.lighting import FoundLights
from photonormal.progress import progress
from photonormal.resources import by_one_thread
from photonormal.types import Capture

FAR_DEG = 16.0  # in the mean: lights that are 15 degrees off are mended, what is farther off may be something else
ALONE = 5.0  # times the mean by which one light moves that stands alone; of lights that are all a little off, up to 3.7


@by_one_thread()
def check(capture: Capture, told: FoundLights | None = None) -> list[Finding]:
    """Everything that may spoil the normals of a capture, grave findings first; an empty list where nothing was found.

    What `photonormal.doctor.findings_of` finds, and lights that the photographs speak against.

    Parameters
    ----------
    told : the lights that the capture is under, where they were found from its photographs
    """
    with progress("checking"):
        found = findings_of(capture)
    if told is not None:
        if told.intensities is not None:  # nobody gave others, which could be corrected
            found = [f for f in found if f.kind != "intensities"]
        return found + [Finding("lights", False, note) for note in told.notes]
    return found + _off(capture, found)


def _off(capture: Capture, found: list[Finding]) -> list[Finding]:
    """Lights that the photographs speak against, where nothing grave was found, which they would hide."""
    from photonormal.methods.uncalibrated.refine import mended

    if any(finding.grave or finding.lights is not None for finding in found):
        return []
    better = mended(capture)
    if better is None or better.moved_deg is None:
        return []
    moved = {name: round(float(v), 1) for name, v in zip(capture.image_names, better.moved_deg, strict=True)}
    worst = max(moved, key=moved.__getitem__)
    mean = float(better.moved_deg.mean())
    message = (
        f"other lights fit the photographs better: they are {mean:.1f} degrees from the given ones in the mean, and at "
        f"most {moved[worst]:.1f} ({worst})"
    )
    if mean > FAR_DEG:
        message += (
            ". That is so far that the given lights may be another capture's, or in another order; compare them with "
            "the rig."
        )
    elif moved[worst] > ALONE * mean:
        message += (
            ". Look at that photograph and its light; if the light is wrong, correct it or measure with "
            "--refine-lights."
        )
    else:
        message += "; measure with --refine-lights."
        return [Finding("lights", False, message, {"moved_deg": moved}, better.lights, {"refine_lights": True})]
    return [Finding("lights", False, message, {"moved_deg": moved})]
