"""One measurement from files to files: photographs -> lights of a sphere, if there is one -> result -> its folder.

`measure`, `batch`, and every process that works for a batch do the same by it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from photonormal.capture import UNKNOWN, files_read, lights_from, load, place_of, reading_told
from photonormal.export.folder import whole_folder
from photonormal.export.mesh import FACES
from photonormal.export.result import write_result
from photonormal.files.opening import Opened, noted
from photonormal.measurement import measure, read_camera
from photonormal.methods import DEFAULT, configure, parse
from photonormal.options import Frame, LightsFrom, Precision
from photonormal.provenance import Made, folder_of, inputs, made_by
from photonormal.rig.spheres import AUTO, calibrate
from photonormal.types import Capture, InputError, Result

if TYPE_CHECKING:
    from photonormal.methods.contract import Solution

PROVENANCE = "provenance"  # in a report
WITHOUT_EFFECT = {"capture", "out", "method", "fast", "device", "overwrite"}  # on values, or part of `made`


@dataclass(frozen=True)
class Job:
    """A capture to be measured, and how.

    Parameters
    ----------
    capture : folder or `.lp` file
    out : folder of the result
    reading : options of `photonormal.load`
    method : with its options, "normalnet:rotations=4"
    fast : whether the method's network looks at half the resolution
    device, precision, expected_error, materials : as for `photonormal.measure`
    integration : a key of photonormal.integration.METHODS; None: no depth and no mesh
    camera : text file with the 3 x 3 camera matrix
    refine_lights : whether lights are mended by what the photographs show
    normals_frame, linear_albedo, mesh_faces : as for `photonormal.export.result.write_result`
    sphere : where lights are found from a mirror sphere: "auto": in the photographs themselves, where they show one; or
        a folder, in the capture's own if there is one of that name; "": nowhere. `located` names the one folder
    overwrite : write into a folder that exists and is no result of photonormal
    """

    capture: Path
    out: Path
    reading: dict[str, Any] = field(default_factory=dict)
    method: str = DEFAULT
    fast: bool = False
    device: str = "auto"
    precision: Precision = "auto"
    integration: str | None = "quadratic"
    camera: Path | None = None
    refine_lights: bool = False
    expected_error: bool = True
    materials: bool = False
    normals_frame: Frame = "opengl"
    linear_albedo: bool = False
    mesh_faces: int = FACES
    sphere: str = ""
    overwrite: bool = False

    @property
    def how(self) -> str:
        """The method with all options that are its own."""
        return self.method + ":fast=true" * self.fast

    @property
    def folder(self) -> Path:
        """Of the capture's photographs."""
        return folder_of(place_of(self.capture))

    def located(self, base: Path = Path()) -> Job:
        """The same, its sphere `AUTO`, one folder's path, or none; `base` is what that is relative to."""
        if self.sphere.upper() in ("", AUTO):
            return replace(self, sphere=AUTO if self.sphere else "")
        inside = self.folder / self.sphere
        return replace(self, sphere=str((inside if inside.is_dir() else base / self.sphere).absolute()))

    def made(self) -> Made:
        """What its result is made by: version, method, options, weights and code."""
        return _made(self.how, lights_from(self.reading.get("lights"), self.refine_lights))

    def asked(self) -> dict[str, Any]:
        """Its other options that have a value and that the result depends on, in JSON's kinds of values."""
        options = {k: v for k, v in asdict(self).items() if k not in WITHOUT_EFFECT} | self.reading
        del options["reading"]
        options.pop("memory", None)
        given = {k: v for k, v in options.items() if v not in (None, "", False)}
        files = {k: str(v if v == UNKNOWN else v.resolve()) for k, v in given.items() if isinstance(v, Path)}
        return dict(sorted((given | files).items()))

    def provenance(self, read: Mapping[Path, Opened]) -> dict[str, Any]:
        """All that its result depends on; `read` are the files that were opened."""
        return {"made": self.made(), "asked": self.asked(), "inputs": inputs(place_of(self.capture), read)}


@cache
def _made(method: str, lights: LightsFrom) -> Made:
    name, options = parse(method)
    return made_by(name, options, lights)


@dataclass(frozen=True)
class SolvedRows:
    """What a process has found of some rows of a capture.

    Parameters
    ----------
    solution : the method's
    read : the files that were opened
    seconds : that it took, reading included
    """

    solution: Solution
    read: dict[Path, Opened]
    seconds: float


def divided(job: Job, megapixels: float, count: int) -> list[slice]:
    """The rows of a capture's frame, in `count` parts at most that other processes may solve; one part where the
    photographs are no larger than so many megapixels, or can't be solved apart.

    Raises
    ------
    InputError
        If the capture can't be used.
    """
    from photonormal.methods.engine import parts

    method, options = parse(job.how)
    capture, reading, _ = _read(job, {})
    small = capture.mask.size <= 1e6 * megapixels
    if small or lights_from(reading.get("lights"), job.refine_lights) != "given":
        return [slice(0, len(capture.mask))]
    return parts.divided(configure(method, **options), capture, count)


def solve_part(job: Job, rows: slice) -> SolvedRows:
    """What the method finds of some rows of a capture.

    Raises
    ------
    InputError
        If the capture can't be used.
    """
    from photonormal.methods.engine import run
    from photonormal.methods.engine.device import torch_device
    from photonormal.methods.learned.processor import computing_in

    start = time.perf_counter()
    method, options = parse(job.how)
    with noted() as opened, computing_in(job.precision):
        capture, _, _ = _read(job, opened)
        found = run(configure(method, **options), capture, torch_device(job.device), rows)
    return SolvedRows(found, opened, time.perf_counter() - start)


def carry_out(
    job: Job,
    read: dict[Path, Opened] | None = None,
    parts: Sequence[SolvedRows] = (),
    beside: Callable[[Result], Mapping[str, bytes]] = lambda result: {},
) -> dict[str, Any]:
    """Measure a capture and write its result; returns the report, as written.

    Parameters
    ----------
    read : is called with the files that are opened, also where this fails
    parts : of all its rows, where other processes have solved them
    beside : gives more files of the result, of `photonormal.export.folder.NAMES`, by name

    Raises
    ------
    InputError
        In one line: what came, what was needed, what to do. Nothing is written then.
    """
    read = {} if read is None else read
    method, options = parse(job.how)
    with noted() as opened:
        for part in parts:
            opened |= part.read
        try:
            K = read_camera(job.camera)
            capture, reading, extra = _read(job, opened)
            made = [job.out / name for name in extra.files]  # of an earlier result, too
            others = (v for v in (job.camera, *reading.values()) if v not in made)
            with whole_folder(job.out, job.overwrite, files_read(job.capture, capture, *others)) as folder:
                result = measure(
                    capture,
                    method,
                    device=job.device,
                    options=options,
                    integration=job.integration,
                    K=K,
                    expected_error=job.expected_error,
                    precision=job.precision,
                    materials=job.materials,
                    lights=lights_from(reading.get("lights"), job.refine_lights),
                    parts=[part.solution for part in parts],
                )
                result.report["seconds"]["solve"] += round(sum(part.seconds for part in parts), 4)
                for name, data in (extra.files | dict(beside(result))).items():
                    folder.write(name, data)
                result.report["warnings"] += extra.notes
                about = reading_told(job.capture, reading, capture) | {PROVENANCE: job.provenance(opened)}
                return write_result(
                    result,
                    folder,
                    job.normals_frame,
                    about,
                    linear_albedo=job.linear_albedo,
                    most_faces=job.mesh_faces,
                )
        finally:
            read |= opened


def _reading(job: Job) -> dict[str, Any]:
    """How its capture is read: without the lights beside it where the method finds them and none are named."""
    method, options = parse(job.how)
    named = job.refine_lights or job.reading.get("lights")
    finds = configure(method, **options).needs.finds_lights
    return job.reading | {"lights": UNKNOWN} if finds and not named else job.reading


@dataclass(frozen=True)
class Calibrated:
    """Files of a calibration by name, and what is to be said of it."""

    files: dict[str, bytes] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def _read(job: Job, opened: dict[Path, Opened]) -> tuple[Capture, dict[str, Any], Calibrated]:
    """The capture under the lights that a sphere shows, or else its own; how it was read; what was calibrated."""
    reading = _reading(job)
    if not job.sphere:
        return load(job.capture, **reading), reading, Calibrated()
    with tempfile.TemporaryDirectory(prefix="photonormal-") as made:
        lights = Path(made) / "sphere.lp"
        try:
            report = calibrate(job.folder, [job.sphere], lights)
        except InputError as error:
            refusal = str(error).removesuffix(f" {lights.with_name('sphere_refused.png')} shows it.")
            if job.sphere != AUTO:
                raise InputError(refusal) from None
            note = f"no sphere gave lights, so the capture's own lights were used: {refusal}"
            try:
                return load(job.capture, **reading), reading, Calibrated(notes=[note])
            except InputError as error:
                raise InputError(f"{error} No sphere gave lights either: {refusal}") from None
        capture = load(job.capture, **reading | {"lights": lights, "frame": "opengl", "lights_as": ""})
        files = {p.name: p.read_bytes() for p in sorted(Path(made).iterdir()) if p.suffix != ".txt"}
        for path in [p for p in opened if p.is_relative_to(Path(made).resolve())]:
            del opened[path]
    return capture, reading | {"lights": job.out / lights.name}, Calibrated(files, report["warnings"])
