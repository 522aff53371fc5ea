"""Commands about the rig: which way the lights are, how bright they are, whether the photographs can be trusted."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import Positional

from photonormal.capture import lights_from
from photonormal.cli.kinds import Box, File, Folder, Millimetres, Numbers, Pixels, next_step, shown, warn, words_of
from photonormal.cli.photographs import Photographs, Read
from photonormal.options import Count, Frame
from photonormal.types import InputError, printable

if TYPE_CHECKING:
    from photonormal.doctor.finding import Finding


@dataclass(frozen=True)
class Calibrate:
    """Find light directions from photographs of a mirror sphere, or of the object alone."""

    folder: Positional[Path]
    """Folder with the object's photographs."""
    sphere: tuple[Path, ...] = (Path("AUTO"),)
    """Folders with photographs of a mirror sphere or a glossy ball, under the same lights in the same order.
    AUTO: the object's photographs show the sphere."""
    from_object: bool = False
    """There is no sphere: find directions and intensities from the photographs of the object."""
    out: Path = Path("lights.lp")
    """File to write. Beside it come light_directions.txt, a JSON report and a picture of the sphere that was found."""
    circle: Annotated[tuple[str, ...], shown("X,Y,R")] = ()
    """Outline of each sphere as x,y,r in pixels from the upper left; by default it is found."""
    count: Count = 1
    """How many spheres each photograph shows."""
    focal_px: Pixels = None
    """Focal length in pixels, for spheres near the camera; by default the camera counts as far away."""
    radius_mm: Millimetres = None
    """Radius of the spheres; with two or more in one frame, the lights' positions are found, too."""
    frame: Frame = "opengl"
    """Frame of the file: opengl (y up, z to the camera), directx (y down), y-down (and z away), z-away or blender."""
    skip: Numbers = ""
    """Photographs to leave out, of the object and the sphere: numbers and ranges from 1, such as 3,7-9."""
    json: bool = False
    """Print the report as one JSON object."""
    overwrite: bool = False
    """Replace files that exist."""

    def __call__(self) -> int:
        from photonormal.export.folder import as_json
        from photonormal.rig.spheres import calibrate

        if self.from_object:
            return self.by_object()
        report = calibrate(
            self.folder,
            self.sphere,
            self.out,
            circles=self.circle,
            count=self.count,
            focal_px=self.focal_px,
            radius_mm=self.radius_mm,
            frame=self.frame,
            skip=self.skip,
            overwrite=self.overwrite,
        )
        warn(report["warnings"])
        if self.json:
            print(as_json(report).decode(), end="")
            return 0
        for sphere in report["spheres"]:
            c = sphere["circle"]
            print(
                f"{sphere['folder']}: sphere at ({c['x']:.1f}, {c['y']:.1f}), radius {c['r']:.1f} px, "
                f"confidence {c['confidence']:.2f} ({sphere['confidence']})"
            )
        print(f"{len(report['lights'])} lights: {', '.join(report['files'])}")
        frame = () if self.frame == "opengl" else ("--frame", self.frame)
        next_step("check", self.folder, "--lights", self.out, *frame)
        return 0

    def by_object(self) -> int:
        """Lights without a sphere."""
        from photonormal.export.folder import as_json
        from photonormal.object_lights import calibrate_from_object

        given = {f.name: getattr(self, f.name) for f in fields(self)}
        for name in ("sphere", "circle", "count", "focal_px", "radius_mm", "skip"):
            if given[name] != type(self).__dataclass_fields__[name].default:
                raise InputError(
                    f"--{name.replace('_', '-')} came with --from-object but it is about a sphere; leave it out."
                )
        report = calibrate_from_object(self.folder, self.out, frame=self.frame, overwrite=self.overwrite)
        warn(report["warnings"])
        if self.json:
            print(as_json(report).decode(), end="")
            return 0
        print(f"{len(report['lights'])} lights: {', '.join(report['files'])}")
        frame = () if self.frame == "opengl" else ("--frame", self.frame)
        next_step(
            "measure", self.folder, "--lights", self.out, *frame, "--intensities", report["files"][1], "--out", "result"
        )
        return 0


@dataclass(frozen=True)
class Intensities:
    """Find how bright each light is, from a matt board under each of them or from the object's own shading."""

    capture: Positional[Path]
    """Folder with photographs and lights, or an .lp file."""
    out: Path = Path("light_intensities.txt")
    """Table to write. Commands read it if it lies beside the photographs, or if --intensities names it."""
    reference: Folder = None
    """Folder with photographs of a matt white or grey board that faces the camera, under the same lights in order."""
    region: Box = ""
    """Where the board is, in pixels of the --reference photographs; without them, of the object's photographs."""
    overwrite: bool = False
    """Replace a file that exists."""
    read: Read = field(default_factory=Photographs)

    def __call__(self) -> int:
        from photonormal.rig.intensities import intensities

        e = intensities(
            self.capture, self.out, self.reference, self.region, overwrite=self.overwrite, **self.read.how()
        )
        print(f"{len(e)} intensities from {e.min():.3f} to {e.max():.3f}: {self.out}")
        read = replace(self.read, lights=replace(self.read.lights, intensities=self.out))
        next_step("check", self.capture, *words_of(read))
        return 0


@dataclass(frozen=True)
class Mask:
    """Draw a mask from the object's shading, with a preview."""

    folder: Positional[Path]
    """Folder with photographs of a lit object on a darker ground, or an .lp file that names them."""
    out: Path = Path("mask.png")
    """Picture to write, white on the object; a preview comes beside it."""
    overwrite: bool = False
    """Replace files that exist."""

    def __call__(self) -> int:
        from photonormal.rig.mask import draw_mask

        drawn = draw_mask(self.folder, self.out, self.overwrite)
        print(f"{drawn.mask}, {drawn.preview}")
        if drawn.left_out:
            print(drawn.left_out)
        next_step("check", self.folder, "--mask", self.out)
        return 0


@dataclass(frozen=True)
class Lights:
    """Choose the lamps of a rig that are worth keeping."""

    what: Positional[Literal["choose"]]
    """choose: find the few lamps that give a network the best normals on rendered objects; it takes minutes."""
    from_: Annotated[Path, tyro.conf.arg(name="from", metavar="FILE")]
    """File with the directions of all lamps of the rig."""
    count: Count = 10
    """How many lamps to keep."""
    out: File = None
    """An .lp file to write, with the lamps to keep."""
    overwrite: bool = False
    """Replace a file that exists."""

    def __call__(self) -> int:
        from photonormal.lamp_choice import choose_from

        found = choose_from(self.from_, self.count, self.out, self.overwrite)
        numbers = ",".join(str(j + 1) for j in found.lamps)
        print(f"keep {len(found.lamps)} lamps: {numbers}")
        print(
            f"the mean error of the method lmps on rendered objects is {found.error_deg:.1f} degrees under them, "
            f"{found.chance_deg:.1f} under as many drawn by chance, and {found.all_deg:.1f} under all"
        )
        if self.out:
            print(self.out)
        next_step("measure", "FOLDER", "--images", numbers, "--out", "result")
        return 0


@dataclass(frozen=True)
class Check:
    """Check a capture before it is measured: exposure, lights, motion. Says what is wrong and what to do."""

    capture: Positional[Path]
    """Folder with photographs and lights, an .lp file, or `demo`."""
    out: Folder = None
    """Folder for a report, a polar plot of the lights, and corrected lights if others fit the photographs better."""
    overwrite: bool = False
    """Write into a folder that holds other files, too."""
    json: bool = False
    """Print the findings as one JSON object."""
    strict: bool = False
    """End with exit code 1 if a finding is grave."""
    refine_lights: bool = False
    """Correct the lights first, so that they fit the photographs, then check."""
    read: Read = field(default_factory=Photographs)

    def __call__(self) -> int:
        from photonormal.export.folder import as_json
        from photonormal.rig.checked import check_files

        found, files = check_files(
            self.capture,
            self.out,
            overwrite=self.overwrite,
            lights_from=lights_from(self.read.lights.lights, self.refine_lights),
            **self.read.how(),
        )
        grave = any(finding.grave for finding in found)
        code = 1 if self.strict and grave else 0
        if self.json:
            content = {"findings": [finding.as_dict() for finding in found], "files": [str(f) for f in files]}
            print(as_json(content).decode(), end="")
            return code
        for finding in found:
            print(f"{'grave' if finding.grave else 'note'}: {finding.kind}: {printable(finding.message)}")
        if not found:
            print("nothing wrong was found")
        if files:
            print(", ".join(str(f) for f in files))
        if any(f.grave and f.lights is None and not f.options and f.kind != "mask" for f in found):
            print("Mend first what is grave, then run this:")
        next_step(*self._next(found))
        return code

    def _next(self, found: list[Finding]) -> tuple[object, ...]:
        """The words of the command that comes next, with the options and lights that mend what was found."""
        if any(f.grave and f.kind == "mask" for f in found):
            return "mask", self.capture, "--out", "object-mask.png"
        options = {name: value for f in found for name, value in f.options.items()}
        refine = ["--refine-lights"] * options.pop("refine_lights", self.refine_lights)
        read = self.read.having(options)
        if any(f.lights is not None and not f.options for f in found):
            if self.out is None:  # which writes them
                return "check", self.capture, *words_of(self.read), *refine, "--out", "report"
            ring = {"ring": None, "elevation": None, "start": 0.0, "clockwise": False}
            own = {"frame": "opengl", "lights_as": "", "dome_radius_mm": None, **ring}
            read = replace(read, lights=replace(read.lights, lights=self.out / "corrected.lp", **own))
        return "measure", self.capture, *words_of(read), *refine, "--out", "result"
