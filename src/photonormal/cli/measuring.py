"""Commands from photographs to results."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional

from photonormal.cli.kinds import File, Where, next_step, shown, warn
from photonormal.cli.photographs import Photographs, Read
from photonormal.export.mesh import FACES
from photonormal.methods import DEFAULT, METHODS, method_class
from photonormal.options import Count, Frame, Precision


@dataclass(frozen=True)
class How:
    """How normals and depth are found."""

    method: Annotated[str, tyro.conf.arg(metavar=f"{{{','.join(METHODS)}}}")] = DEFAULT
    """Method that finds the normals; options follow a colon: normalnet:rotations=4. `photonormal methods` lists all."""
    fast: bool = False
    """About three times as fast: the network works at half the resolution, and a classical method adds the detail."""
    device: Where = "auto"
    """Where methods compute; auto: on a GPU if there is one."""
    precision: Precision = "auto"
    """Number format of networks; auto: bf16 where the machine has instructions for it, else float32."""
    integration: Literal["simchony", "quadratic", "bilateral"] = "quadratic"
    """How depth is found; bilateral lets the depth jump at edges."""
    sphere: Annotated[str, shown("auto|FOLDER")] = ""
    """Find the lights by a mirror sphere. auto: the photographs may show one.
    FOLDER: it has photographs of a sphere under the same lights; it is the capture's own, or one for all."""
    refine_lights: bool = False
    """Correct lights that may be off by some degrees each, so that they fit the photographs."""
    camera: File = None
    """Text file with the 3 x 3 camera matrix in pixels; with it the depth is perspective."""


@dataclass(frozen=True)
class Written:
    """What is written."""

    mesh: bool = True
    """Write depth and mesh."""
    mesh_faces: Count = FACES
    """About how many triangles the mesh may have; a larger mesh keeps every second, third ... row and column only."""
    expected_error: bool = True
    """Estimate how many degrees each normal is off."""
    materials: bool = False
    """Write maps of base colour, roughness, metalness and specular level, where highlights show them."""
    normals_frame: Frame = "opengl"
    """Frame of normals.png: opengl (green up), directx (green down), y-down, z-away or blender."""
    linear_albedo: bool = False
    """Write albedo.png without the sRGB curve."""


@dataclass(frozen=True)
class Results(Written):
    """What is written, where, and what is printed."""

    json: bool = False
    """Print the report as one JSON object."""
    overwrite: bool = False
    """Write into a folder that holds other files, too."""


def of_job(by: How, written: Written) -> dict[str, Any]:
    """The options as fields of a `photonormal.job.Job`."""
    options = asdict(by) | {field.name: getattr(written, field.name) for field in fields(Written)}
    if not options.pop("mesh"):
        options["integration"] = None
    return options


@dataclass(frozen=True)
class Measure:
    """Measure one object: find its normals, albedo, depth and mesh from photographs."""

    capture: Positional[Path]
    """Folder with photographs and lights, or an .lp file, or `demo`, the capture that comes with photonormal."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Folder for the results."""
    read: Read = field(default_factory=Photographs)
    method: OmitArgPrefixes[How] = How()
    results: OmitArgPrefixes[Results] = Results()

    def __call__(self) -> int:
        from photonormal.export.folder import as_json
        from photonormal.job import Job, carry_out

        written = self.results
        how = of_job(self.method, written)
        job = Job(self.capture, self.out, self.read.how(), overwrite=written.overwrite, **how)
        report = carry_out(job.located())
        warn(report["warnings"])
        if written.json:
            print(as_json(report).decode(), end="")
            return 0
        seconds = sum(report["seconds"].values())
        print(
            f"{report['pixels']['measured']} normals from {report['lights']} photographs by {report['method']} "
            f"in {seconds:.1f} s: {self.out}"
        )
        if "expected_error_deg" in report:
            where = self.out / "expected-error.png"
            print(f"expected to be off by {report['expected_error_deg']:.1f} degrees on average: {where}")
        if report.get("mesh", {}).get("every", 1) > 1:
            print(f"the mesh has one of {report['mesh']['every']} rows and columns, see --mesh-faces")
        if moved := report.get("found_lights", {}).get("moved_deg"):
            print(
                f"the lights moved by {sum(moved) / len(moved):.1f} degrees, at most {max(moved):.1f}: "
                f"{self.out / 'lights.lp'}"
            )
        if "score" in report:
            print(f"mean angular error {report['score']['mean_deg']:.2f} degrees against the true normals")
        next_step("view", self.out)
        return 0


@dataclass(frozen=True)
class Methods:
    """List the methods of `measure`, with a line about each."""

    def __call__(self) -> int:
        width = max(map(len, METHODS))
        for name in METHODS:
            summary = sys.modules[method_class(name).__module__].__doc__ or ""
            print(f"{name:{width}}  {summary.strip().splitlines()[0]}")
        return 0
