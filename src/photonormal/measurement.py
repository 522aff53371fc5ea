"""The main path as a value: Capture -> Result. It writes nothing; `photonormal.export` does."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import photonormal
from photonormal.doctor.finding import Finding
from photonormal.examination import check
from photonormal.integration import integrate
from photonormal.lighting import FoundLights
from photonormal.masked import box_of, picked, row_bands
from photonormal.methods import DEFAULT, configure, options_of
from photonormal.options import Device, LightsFrom, Precision, check_value
from photonormal.progress import progress
from photonormal.resources import hand_back, peak_mb
from photonormal.scoring import score
from photonormal.types import Capture, InputError, Materials, Normals, Result, Surface, as_capture

if TYPE_CHECKING:
    import torch

    from photonormal.materials.interreflections import Brightening
    from photonormal.methods.contract import Method, Solution

INEXACT = (
    "Materials need exact lights, and these were found from the photographs: an error of some degrees looks like "
    "gloss, and base_colour.png gets dark spots. Compare it with albedo.png, or take the lights from a mirror sphere."
)


def measure(
    capture: Capture,
    method: str = DEFAULT,
    device: str = "auto",
    options: dict[str, Any] | None = None,
    integration: str | None = "quadratic",
    K: np.ndarray | None = None,
    albedo: bool = True,
    expected_error: bool = True,
    examine: bool = True,
    precision: Precision = "auto",
    lights: LightsFrom = "given",
    materials: bool = False,
    parts: Sequence[Solution] = (),
) -> Result:
    """Normals, albedo and depth of one capture; nothing is written.

    Parameters
    ----------
    capture : photographs, mask and lights, as `photonormal.load` gives them
    method : a key of photonormal.methods.METHODS; `options` are its fields
    device : "auto", "cpu" or "cuda"
    integration : a key of photonormal.integration.METHODS; None: no depth
    K : (3, 3) camera matrix of the whole photographs, pixels, for a perspective surface; None: the capture's own, if it
        has one
    albedo : whether to find it, which takes lights, given or found by the method; so do expected errors. With depth,
        light that parts of the surface send each other is taken out where it can be found
    expected_error : whether to estimate by how much each normal may be wrong
    examine : whether to look for faults of the photographs and lights (`photonormal.check`), the report's warnings
    precision : what networks compute in, "float32" or "bf16"; "auto": bf16 where the machine has instructions for it
    lights : "given"; "refined": the capture's lights may be off by some degrees each and are mended by what the
        photographs show; "unknown": the capture's are not looked at, all is found from the photographs, intensities,
        too (`photonormal.methods.uncalibrated`)
    materials : whether to estimate what the surface is made of (`photonormal.materials`), which takes lights
    parts : what the method has found of rows of this capture, where other processes solved it
        (`photonormal.methods.engine.parts`)

    Raises
    ------
    InputError
        If the method or an option does not exist, or the capture can't be measured by it.
    """
    capture = as_capture(capture)
    check_value(device, Device, "device")
    check_value(precision, Precision, "precision")
    check_value(lights, LightsFrom, "lights")
    solver = configure(method, **(options or {}))
    from photonormal.methods.engine.device import torch_device

    where = torch_device(device)
    lights = _lights_from(lights, solver, capture, method, materials)
    seconds: dict[str, float] = {}
    samples, found = None, None
    findings: list[Finding] = []
    if examine:
        with _stage("read", seconds):
            samples = _read(capture)
    if lights != "given":
        from photonormal.methods.learned.processor import computing_in
        from photonormal.methods.uncalibrated import found_lights

        with _stage("lights", seconds), computing_in(precision):
            found = found_lights(capture, lights, device)
        capture = found.shown_by(capture)
    if examine:
        with _stage("check", seconds):
            findings = check(capture, found)
    warnings = [finding.message for finding in findings] if examine or found is None else list(found.notes)
    solved = _solved(solver, capture, where, precision, parts, expected_error, seconds)
    normals, lit, found = solved.normals, solved.lit, found or solved.found
    warnings += lit.notes[len(capture.notes) :]
    surface = None
    if integration is not None:
        with _stage("integrate", seconds), progress(f"depth by {integration}"):
            surface = integrate(normals, integration, K=_camera_matrix(capture, K))
    seen = _appearance(lit, normals, surface, albedo, materials, seconds)
    if materials and found is not None:
        warnings.append(INEXACT)
    if dark := int(capture.mask.sum()) - int(normals.mask.sum()):
        warnings.append(f"{dark} pixels of the mask have no normal: no light reached them.")
    report = {
        "photonormal": photonormal.__version__,
        **_facts(capture, normals),
        "method": method,
        "options": options_of(solver),
        "integration": integration,
        "device": str(where),
        "precision": solved.computed_in,
        "samples": samples,
        "seconds": seconds,
        "peak_memory_mb": peak_mb(),
        "weights_sha256": getattr(solver, "weights_sha256", None),
        "warnings": warnings,
        "findings": [finding.as_dict() for finding in findings],
    }
    if seen.albedo is not None and surface is not None:
        report["interreflections"] = None if seen.between is None else seen.between.as_dict()
    if found is not None:
        report["found_lights"] = found.as_dict()
    lit_by = (None, None) if found is None else (found.lights, found.intensities)
    return Result(capture, normals, seen.albedo, surface, *lit_by, report, seen.materials)


def _lights_from(lights: LightsFrom, solver: Method, capture: Capture, method: str, materials: bool) -> LightsFrom:
    """Where the lights come from; refuses what the method, or what is asked of it, can't do."""
    if solver.needs.finds_lights:
        if lights == "refined":
            raise InputError(f"{method} finds the lights itself; leave --refine-lights out, or choose another method.")
        lights = "given"  # it looks at none
    if lights == "given":
        from photonormal.methods.engine import check_needs

        check_needs(solver, capture)
        if materials and capture.lights is None and not solver.needs.finds_lights:
            raise InputError(
                f"{capture.name} has no light directions but materials need them; add light_directions.txt or an .lp, "
                "or leave --materials out."
            )
    return lights


class _Solved(NamedTuple):
    """What a method found: normals, the capture under the lights that it was measured by, the lights that the method
    found itself, and what a network computed in."""

    normals: Normals
    lit: Capture
    found: FoundLights | None
    computed_in: str | None


def _solved(
    solver: Method,
    capture: Capture,
    where: torch.device,
    precision: Precision,
    parts: Sequence[Solution],
    expected_error: bool,
    seconds: dict[str, float],
) -> _Solved:
    """A method's normals, and by how much each of them is expected to be off."""
    from photonormal.methods.contract import Streaming
    from photonormal.methods.engine import on_mask, prepared, run_as_it_is, with_lights
    from photonormal.methods.engine.near import seen_as_distant
    from photonormal.methods.engine.parts import joined
    from photonormal.methods.learned.processor import computing_in, number_format

    with _stage("solve", seconds):
        whole, lights = prepared(solver, capture), None
        with computing_in(precision):
            found = joined(parts, capture) if parts else run_as_it_is(solver, whole, where)
            computed_in = number_format(where, solver.exact) if isinstance(solver, Streaming) else None
        normals = on_mask(found, capture)
    lit, told_deg = with_lights(whole, found), found.told_deg
    if found.lights is not None:
        lights = FoundLights(found.lights.numpy(), None if found.intensities is None else found.intensities.numpy())
    del found  # its normals lie in the map
    if expected_error and lit.lights is not None:
        from photonormal.methods.expected import with_expected_error

        with _stage("expected error", seconds):
            lit = seen_as_distant(lit, normals)
            normals = with_expected_error(normals, told_deg, lit, solver, where)
    return _Solved(normals, lit, lights, computed_in)


class _Appearance(NamedTuple):
    """What the surface looks like, as far as it was asked for, and the light between its parts that was taken out."""

    albedo: np.ndarray | None
    materials: Materials | None
    between: Brightening | None


def _appearance(
    lit: Capture, normals: Normals, surface: Surface | None, albedo: bool, materials: bool, seconds: dict[str, float]
) -> _Appearance:
    """Albedo and materials; with a surface, without the light that its parts send each other."""
    rho = made_of = between = None
    if materials:
        from photonormal.materials import materials_of

        with _stage("materials", seconds):
            made_of = materials_of(lit, normals)
    if albedo and lit.lights is not None:
        from photonormal.methods.albedo import lambertian_albedo

        with _stage("albedo", seconds):
            rho = lambertian_albedo(lit, normals)
    if rho is not None and surface is not None:
        from photonormal.materials.interreflections import brightening

        with _stage("inter-reflections", seconds), progress("light between parts"):
            between = brightening(lit, normals, surface, rho)
            if between is not None:
                for each in [rho] if made_of is None else [rho, made_of.albedo]:
                    between.take_from(each)
    return _Appearance(rho, made_of, between)


def _facts(capture: Capture, normals: Normals) -> dict[str, Any]:
    """What a report says of the capture and of its normals."""
    inside, measured = int(capture.mask.sum()), int(normals.mask.sum())
    facts: dict[str, Any] = {
        "capture": capture.name,
        "images": list(capture.image_names),
        "lights": capture.images.shape[0],
        "crop": None if capture.crop is None else capture.crop.as_dict(),
        "light": "distant" if capture.lamps is None else "near",
        "pixels": {"mask": inside, "measured": measured, "dark": inside - measured},
    }
    if normals.expected_error_deg is not None:
        facts["expected_error_deg"] = round(float(np.nanmean(normals.expected_error_deg)), 3)
    if capture.truth is not None:
        facts["score"] = score(normals, capture.truth).as_dict()
    return facts


def _camera_matrix(capture: Capture, K: np.ndarray | None) -> np.ndarray | None:
    """The capture's own, or `K` of the whole photographs as one of what the capture shows of them."""
    if K is None:
        return None if capture.camera is None else capture.camera.K
    return K if capture.crop is None else capture.crop.matrix(K)


def read_camera(path: Path | None) -> np.ndarray | None:
    """The camera matrix in a text file of 3 rows; None for an orthographic view."""
    if path is None:
        return None
    from photonormal.capture.texts import read_table

    return read_table(path)


def _read(capture: Capture) -> dict[str, float]:
    """Decode every picture once, in threads; samples inside the mask that are saturated or zero, in per cent."""
    n, _, _, c = capture.images.shape
    columns = box_of(capture.mask)[1]
    with progress(f"reading {n} images", n) as advance:

        def count(j: int) -> tuple[int, int]:
            saturated = zero = 0
            for rows in row_bands(capture.mask):
                image, inside = capture.window(j, rows, columns), capture.mask[rows, columns]
                saturated += int(np.count_nonzero(picked(capture.saturated(j, rows, columns, image), inside)))
                zero += int(np.count_nonzero(picked(image, inside) <= 0))
            advance()
            return saturated, zero

        saturated, zero = np.sum(capture.each_image(count), axis=0)
    total = n * c * int(capture.mask.sum())
    return {
        "saturated_percent": round(100 * float(saturated) / total, 3),
        "zero_percent": round(100 * float(zero) / total, 3),
    }


@contextmanager
def _stage(name: str, seconds: dict[str, float]) -> Iterator[None]:
    start = time.perf_counter()
    yield
    hand_back()  # what it made and freed
    seconds[name] = round(seconds.get(name, 0.0) + time.perf_counter() - start, 4)
