"""Between a capture and a method: windows, lamps, priors, memory and devices. A method sees none of them."""

from __future__ import annotations

from contextlib import nullcontext

import torch

from photonormal.lighting import under
from photonormal.masked import on_map
from photonormal.methods.contract import Method, Solution, Solver, Streaming
from photonormal.types import Capture, InputError, Normals, lights_behind


def run(method: Method, capture: Capture, device: torch.device, rows: slice | None = None) -> Solution:
    """What a method knows of a capture's pixels on the mask, whether lights are distant or near; on the processor.

    `rows`: of those that lie in some rows of the frame, as `parts.divided` gives them; the solutions of all such parts,
    `parts.joined`, are that of the whole.

    What is certainly wrong with pictures is mended first (`prepared`).

    Raises
    ------
    InputError
        If the capture is not what the method needs, all its pictures are alike, or no light reached any pixel.
    """
    return run_as_it_is(method, prepared(method, capture), device, rows)


def prepared(method: Method, capture: Capture) -> Capture:
    """The capture as a method that knows the lights is to see it; its notes say what was done.

    Dark pictures that were cut off to whole grey levels get back what that took (`engine.cutoff`). Where the method
    asks for it, pictures are divided by what they are brighter than their lights' intensities say (`engine.evened`).
    """
    from photonormal.methods.engine.cutoff import given_back
    from photonormal.methods.engine.evened import evened
    from photonormal.methods.engine.looks import refuse_alike, refuse_huge

    refuse_huge(capture)
    if not method.needs.lights:
        return capture
    refuse_alike(capture)
    capture = given_back(capture)
    return evened(capture, method) if isinstance(method, Streaming) else capture


def run_as_it_is(method: Method, capture: Capture, device: torch.device, rows: slice | None = None) -> Solution:
    """The same of a capture that is `prepared`."""
    check_needs(method, capture)
    if capture.lamps is not None and not method.needs.finds_lights:
        from photonormal.methods.engine.near import UnderLamps

        found = UnderLamps(lambda c: under_distant_lights(method, c, device))(capture)
    else:
        found = under_distant_lights(method, capture, device, rows)
    return found if rows else not_dark(found, capture)


def check_needs(method: Method, capture: Capture) -> None:
    """InputError where a capture is not what a method needs."""
    needs, n = method.needs, capture.images.shape[0]
    if n < needs.images:
        from photonormal.methods import name_of

        raise InputError(
            f"{n} images came but {name_of(method)} needs {needs.images} or more lights; "
            "add photographs or use woodham."
        )
    if needs.lights and len(lights_behind(capture.known_lights())) == n:
        raise InputError(
            f"all {n} lights of {capture.name} lie behind the object (z below 0) but z has to point from the object to "
            "the camera; turn its sign in the file."
        )


def under_distant_lights(method: Method, capture: Capture, device: torch.device, rows: slice | None = None) -> Solution:
    """The same where no lamp is near; zero for a pixel that no light reached."""
    from photonormal.methods.engine import halved, narrow, samples, stream

    with nullcontext() if method.needs.optimises else torch.inference_mode():
        if isinstance(method, Streaming):
            if narrow.is_narrow(capture):
                return narrow.with_border(lambda wide: stream.streamed(method, wide, device), capture, rows)
            return (
                halved.halved(method, capture, device)
                if method.fast
                else stream.streamed(method, capture, device, rows)
            )
        assert isinstance(method, Solver)
        if method.needs.reads == "object":
            return samples.whole_object(method, capture, device)
        return samples.by_pixel(method, capture, device, rows)


def not_dark(found: Solution, capture: Capture) -> Solution:
    """What was found of a whole capture, or InputError where no light reached any of its pixels."""
    if not (found.normals.norm(dim=-1) > 0.5).any():
        raise InputError(f"all pixels of {capture.name} inside the mask are dark; check exposure, mask and images.")
    return found


def on_mask(solution: Solution, capture: Capture) -> Normals:
    """A map of a solution's normals; pixels whose normal is zero are left out of its mask."""
    found = (solution.normals.norm(dim=-1) > 0.5).numpy()
    mask = capture.mask.copy()
    mask[capture.mask] = found
    return Normals(on_map(solution.normals.numpy(), capture.mask), mask)


def with_lights(capture: Capture, solution: Solution) -> Capture:
    """The capture under the lights, and divided by the intensities, that a method found, if it did."""
    lights, intensities = (None if v is None else v.double().numpy() for v in (solution.lights, solution.intensities))
    return under(capture, lights, intensities)
