"""Dataclasses that become commands: parse, call, print. The work is elsewhere."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from photonormal.types import InputError


@dataclass(frozen=True)
class Photographs:
    """How the photographs are read."""

    images: str = ""
    """Subset of the photographs by number, such as 1-10,15; all by default."""
    format: str = "auto"
    """Layout of the capture, when its content does not tell: diligent, rti, folder, ..."""
    lights: Path | None = None
    """File with light directions, instead of the capture's own."""
    mask: Path | None = None
    """Mask picture, white on the object, instead of the capture's own."""
    srgb: bool = False
    """The photographs are sRGB-encoded, as camera JPEGs are, and have to be linearised."""
    linear: bool = False
    """They are linear, though JPEGs declare sRGB in their Exif data, which is believed otherwise."""
    frame: str = "opengl"
    """Frame of the light directions: opengl (y up, z to the camera), directx (y down), y-down (and z away)."""
    intensities: Path | None = None
    """File with light intensities, instead of the capture's own."""
    exif_exposure: bool = False
    """Divide by the exposures that the photographs tell in their Exif data."""
    dark: Path | None = None
    """Picture taken with all lights off, which is subtracted: ambient light and the sensor's black."""
    flat: Path | None = None
    """Picture of an even white surface, by which the photographs are divided: vignetting and dust."""
    hot_pixels: bool = False
    """Replace pixels that stand out of their surroundings in the dark picture, or in all photographs."""
    lens: Path | None = None
    """Lens calibration that OpenCV wrote (.yml), whose distortion is taken out."""


Read = Annotated[Photographs, tyro.conf.arg(name="")]


@dataclass(frozen=True)
class Measure:
    """Normals, albedo, depth and mesh of one object from its photographs."""

    capture: Positional[Path]
    """Folder with photographs and lights, an .lp file, or `demo`: the capture that comes with photonormal."""
    out: Path
    """Folder for the results; it is written whole or not at all."""
    method: str = "woodham"
    """One of `photonormal methods`."""
    device: str = "auto"
    """auto, cpu or cuda."""
    normals_frame: str = "opengl"
    """Frame of normals.png: opengl (green up), directx (green down) or y-down (and z away from the camera)."""
    integration: str = "quadratic"
    """How depth is found: simchony, quadratic or bilateral."""
    camera: Path | None = None
    """Text file with the 3 x 3 camera matrix in pixels, for a perspective surface."""
    mesh: bool = True
    """Write depth and mesh."""
    overwrite: bool = False
    """Write into a folder that exists and is no result of photonormal."""
    read: Read = Photographs()

    def __call__(self) -> int:
        from photonormal.measure import measure

        report = measure(
            self.capture,
            self.out,
            method=self.method,
            device=self.device,
            mesh=self.mesh,
            overwrite=self.overwrite,
            integration=self.integration,
            normals_frame=self.normals_frame,
            camera=self.camera,
            **asdict(self.read),
        )
        for warning in report["warnings"]:
            print(f"photonormal: warning: {warning}", file=sys.stderr)
        seconds = sum(report["seconds"].values())
        print(
            f"{report['pixels']['measured']} normals from {report['lights']} photographs by {report['method']} "
            f"in {seconds:.1f} s: {self.out}"
        )
        if "score" in report:
            print(f"mean angular error {report['score']['mean_deg']:.2f} degrees against the true normals")
        return 0


@dataclass(frozen=True)
class Score:
    """Angular error of a result against the true normals of its capture."""

    capture: Positional[Path]
    """The capture, with ground truth."""
    result: Positional[Path]
    """Folder that `measure` wrote, or a normal map (.npz, .png, .exr)."""
    format: str = "auto"
    """Layout of the capture."""
    frame: str = "opengl"
    """Frame of the result's normals: opengl, directx or y-down."""
    json: bool = False
    """Print one JSON object."""

    def __call__(self) -> int:
        from photonormal.capture import load
        from photonormal.export import load_normals
        from photonormal.score import score

        truth = load(self.capture, format=self.format).truth
        if truth is None:
            raise InputError(f"{self.capture} has no true normals to score against; add Normal_gt.mat.")
        result = score(load_normals(self.result, self.frame), truth).as_dict()
        if self.json:
            print(json.dumps(result))
        else:
            print(
                f"mean {result['mean_deg']:.2f}, median {result['median_deg']:.2f} degrees; "
                f"{result['below_15']:.1f} % below 15, {result['below_30']:.1f} % below 30 ({result['pixels']} pixels)"
            )
        return 0


@dataclass(frozen=True)
class Integrate:
    """Depth or a mesh from a normal map."""

    normals: Positional[Path]
    """Normal map (.npz, 16-bit .png, .exr), or a folder that `measure` wrote."""
    out: Path
    """File to write: .npz (depth), .ply, .obj or .glb (mesh)."""
    method: str = "quadratic"
    """simchony, quadratic or bilateral."""
    camera: Path | None = None
    """Text file with the 3 x 3 camera matrix in pixels, for a perspective view."""
    frame: str = "opengl"
    """Frame of the normal map: opengl (green up), directx (green down) or y-down (and z away from the camera)."""
    overwrite: bool = False
    """Replace a file that exists."""

    def __call__(self) -> int:
        from photonormal.export import load_normals, save
        from photonormal.integrate import integrate
        from photonormal.measure import read_camera
        from photonormal.progress import progress

        if self.out.exists() and not self.overwrite:
            raise InputError(f"{self.out} exists; choose another --out, or add --overwrite to replace it.")
        normals = load_normals(self.normals, self.frame)
        with progress(f"depth by {self.method}"):
            surface = integrate(normals, self.method, K=read_camera(self.camera))
        print(save(surface, self.out, normals))
        return 0


@dataclass(frozen=True)
class Calibrate:
    """Light directions from photographs of a mirror sphere."""

    folder: Positional[Path]
    """The object's photographs, which the lights are for."""
    sphere: tuple[Path, ...] = (Path("AUTO"),)
    """Folders with photographs of a mirror sphere under the same lights in the same order; AUTO: it is in FOLDER's."""
    out: Path = Path("lights.lp")
    """File to write; light_directions.txt, a JSON report and a picture of what was found are written beside it."""
    circle: tuple[str, ...] = ()
    """Outlines x,y,r in pixels from the upper left, one for each sphere; found where none are given."""
    count: int = 1
    """Spheres that each photograph shows."""
    focal_px: float | None = None
    """Focal length in pixels, for spheres near the camera; a camera far away without it."""
    radius_mm: float | None = None
    """The spheres' radius; with two or more in one frame the lights' positions are found too."""
    frame: str = "opengl"
    """Frame of what is written: opengl (y up, z to the camera), directx (y down) or y-down (and z away)."""
    overwrite: bool = False
    """Replace files that exist."""

    def __call__(self) -> int:
        from photonormal.rig import calibrate

        report = calibrate(
            self.folder,
            self.sphere,
            self.out,
            circles=self.circle,
            count=self.count,
            focal_px=self.focal_px,
            radius_mm=self.radius_mm,
            frame=self.frame,
            overwrite=self.overwrite,
        )
        for warning in report["warnings"]:
            print(f"photonormal: warning: {warning}", file=sys.stderr)
        for sphere in report["spheres"]:
            c = sphere["circle"]
            print(
                f"{sphere['folder']}: sphere at ({c['x']:.1f}, {c['y']:.1f}), radius {c['r']:.1f} px, "
                f"confidence {c['confidence']:.2f}"
            )
        print(f"{len(report['lights'])} lights: {', '.join(report['files'])}")
        return 0


@dataclass(frozen=True)
class Check:
    """What is wrong with a capture, before it is measured: exposure, lights, motion, and what to do."""

    capture: Positional[Path]
    """Folder with photographs and lights, an .lp file, or `demo`."""
    out: Path | None = None
    """Folder for a report, a polar plot of the lights, and corrected lights where other ones fit the photographs."""
    overwrite: bool = False
    """Write into a folder that exists and is no result of photonormal."""

    read: Read = Photographs()

    def __call__(self) -> int:
        from photonormal.rig import check

        found, files = check(
            self.capture,
            self.out,
            overwrite=self.overwrite,
            **asdict(self.read),
        )
        for finding in found:
            print(f"{'grave' if finding.grave else 'note'}: {finding.kind}: {finding.message}")
        if not found:
            print("nothing wrong was found")
        if files:
            print(", ".join(str(f) for f in files))
        return 0


@dataclass(frozen=True)
class Bench:
    """Predict the normals of a benchmark's objects by several methods, and store them."""

    benchmark: Positional[str]
    """diligent, materials, cycles, blobby or lightstage."""
    root: Positional[Path]
    """Folder with the benchmark's objects; absent ones are left blank."""
    out: Path = Path("runs")
    """Folder of the predictions; what it holds is not predicted again."""
    methods: str = "all"
    """Methods like woodham,l1; one may enter again as label=method:option=value."""
    images: str = "all"
    """How many images: all, or counts like 10 or 8,16,96."""
    draws: int = 10
    """Random draws of fixed seeds where fewer than all images are used, besides the one of PS-FCN's code."""
    fixed: tuple[Path, ...] = ()
    """Text files with image numbers like 1-10,15, or lines `object: 1-10,15`."""
    objects: str = ""
    """Only these objects, like ball,cat."""
    device: str = "auto"
    """auto, cpu or cuda."""
    jobs: int = 1
    """Objects at a time; more than one disturbs the seconds measured."""

    def __call__(self) -> int:
        from photonormal.bench import bench

        done = bench(
            self.benchmark,
            self.root,
            self.out,
            methods=self.methods,
            images=self.images,
            draws=self.draws,
            fixed=self.fixed,
            objects=self.objects,
            device=self.device,
            jobs=self.jobs,
        )
        for failure in done.failures:
            print(f"photonormal: {failure}", file=sys.stderr)
        print(f"{done.predicted} predictions stored in {self.out}, {done.kept} were there, {len(done.failures)} failed")
        return 1 if done.failures else 0


@dataclass(frozen=True)
class Intensities:
    """Intensities of the lights, from a matt board under each of them or from the object's own shading."""

    capture: Positional[Path]
    """Folder with photographs and lights, or an .lp file."""
    out: Path = Path("light_intensities.txt")
    """Table to write; it is read where it lies beside the photographs, or named by --intensities."""
    reference: Path | None = None
    """Folder with photographs of a matt white or grey board that faces the camera, under the same lights in order."""
    region: str = ""
    """Where the board is, x0,y0,x1,y1 in pixels: in the reference's photographs, or in the object's without one."""
    overwrite: bool = False
    """Replace a file that exists."""
    read: Read = Photographs()

    def __call__(self) -> int:
        from photonormal.rig import intensities

        e = intensities(
            self.capture, self.out, self.reference, self.region, overwrite=self.overwrite, **asdict(self.read)
        )
        print(f"{len(e)} intensities from {e.min():.3f} to {e.max():.3f}: {self.out}")
        return 0


@dataclass(frozen=True)
class Mask:
    """A mask picture from the object's shading, with a preview."""

    folder: Positional[Path]
    """Photographs of a lit object on a darker ground."""
    out: Path = Path("mask.png")
    """Picture to write, white on the object; a preview is written beside it."""
    overwrite: bool = False
    """Replace files that exist."""

    def __call__(self) -> int:
        from photonormal.rig import draw_mask

        print(", ".join(str(p) for p in draw_mask(self.folder, self.out, self.overwrite)))
        return 0


@dataclass(frozen=True)
class Table:
    """Tables of stored predictions: errors, published figures beside them, seconds and memory."""

    runs: Positional[Path]
    """Folder that `bench` wrote."""
    markdown: bool = False
    """Print Markdown, which is the default."""
    json: bool = False
    """Print JSON."""
    latex: bool = False
    """Print LaTeX."""
    methods: str = ""
    """Only these, like woodham,l1."""
    datasets: str = ""
    """Only these, like diligent."""
    published: bool = False
    """Add published figures of methods that are not in photonormal."""

    def __call__(self) -> int:
        from photonormal.bench.formats import FORMATS
        from photonormal.bench.tables import tables

        chosen = [name for name in FORMATS if getattr(self, name)] or ["markdown"]
        if len(chosen) > 1:
            raise InputError(f"--{' and --'.join(chosen)} came but one format is printed; choose one.")
        found = tables(self.runs, listed(self.methods), listed(self.datasets), self.published)
        print(FORMATS[chosen[0]](found), end="")
        return 0


@dataclass(frozen=True)
class Figure:
    """A figure from stored predictions, or from training logs, as PNG and PDF."""

    name: Positional[str]
    """errors, normals, images, seconds, materials or convergence."""
    places: Positional[tuple[str, ...]]
    """The folder that `bench` wrote; for convergence, folders of trainings, as FOLDER or LABEL=FOLDER."""
    out: Path | None = None
    """Folder to write into; by default `figures` in the folder of runs."""
    dataset: str = ""
    """Which dataset, where the runs hold several."""
    methods: str = ""
    """Only these, like woodham,l1, in this order."""
    objects: str = ""
    """Only these, like ball,cat, in this order."""
    limit: float | None = None
    """Error in degrees of the last colour of error maps."""

    def __call__(self) -> int:
        from photonormal.bench.figures import figure

        methods, objects = listed(self.methods), listed(self.objects)
        for path in figure(self.name, self.places, self.out, self.dataset, methods, objects, self.limit):
            print(path)
        return 0


@dataclass(frozen=True)
class Convert:
    """A normal map in another frame or another format."""

    normals: Positional[Path]
    """Normal map (.npz, 16-bit .png, .exr), or a folder that `measure` wrote."""
    out: Path
    """File to write: .png (16-bit), .exr or .npz."""
    from_frame: str = "opengl"
    """Frame of NORMALS: opengl (green up), directx (green down) or y-down (and z away from the camera)."""
    frame: str = "opengl"
    """Frame of what is written."""
    overwrite: bool = False
    """Replace a file that exists."""

    def __call__(self) -> int:
        from photonormal.export import load_normals, save

        if self.out.exists() and not self.overwrite:
            raise InputError(f"{self.out} exists; choose another --out, or add --overwrite to replace it.")
        print(save(load_normals(self.normals, self.from_frame), self.out, frame=self.frame))
        return 0


@dataclass(frozen=True)
class Figure:
    """A figure from stored predictions, or from training logs, as PNG and PDF."""

    name: Positional[str]
    """errors, normals, images, seconds, materials or convergence."""
    places: Positional[tuple[str, ...]]
    """The folder that `bench` wrote; for convergence, folders of trainings, as FOLDER or LABEL=FOLDER."""
    out: Path | None = None
    """Folder to write into; by default `figures` in the folder of runs."""
    dataset: str = ""
    """Which dataset, where the runs hold several."""
    methods: str = ""
    """Only these, like woodham,l1, in this order."""
    objects: str = ""
    """Only these, like ball,cat, in this order."""
    limit: float | None = None
    """Error in degrees of the last colour of error maps."""

    def __call__(self) -> int:
        from photonormal.bench.figures import figure

        methods, objects = listed(self.methods), listed(self.objects)
        for path in figure(self.name, self.places, self.out, self.dataset, methods, objects, self.limit):
            print(path)
        return 0


@dataclass(frozen=True)
class Report:
    """One HTML file with tables to sort, maps to compare and surfaces to turn; it needs no server or network."""

    runs: Positional[Path]
    """Folder that `bench` wrote."""
    out: Path = Path("report.html")
    """File to write."""
    methods: str = ""
    """Only these, like woodham,l1."""
    datasets: str = ""
    """Only these, like diligent."""
    objects: str = ""
    """Objects to show maps of; by default up to 12 of each dataset."""
    surfaces: bool = True
    """Integrate the normals of each object's best method."""
    overwrite: bool = False
    """Replace a file that exists."""

    def __call__(self) -> int:
        from photonormal.bench.page import report

        path = report(
            self.runs,
            self.out,
            methods=listed(self.methods),
            datasets=listed(self.datasets),
            shown=listed(self.objects),
            surfaces=self.surfaces,
            overwrite=self.overwrite,
        )
        print(path)
        return 0


@dataclass(frozen=True)
class Methods:
    """The methods that `measure` knows, with a line about each."""

    def __call__(self) -> int:
        from photonormal.solve import METHODS, method_class

        width = max(map(len, METHODS))
        for name in METHODS:
            summary = sys.modules[method_class(name).__module__].__doc__ or ""
            print(f"{name:{width}}  {summary.strip().splitlines()[0]}")
        return 0


Command = (
    Annotated[Measure, tyro.conf.subcommand("measure")]
    | Annotated[Score, tyro.conf.subcommand("score")]
    | Annotated[Integrate, tyro.conf.subcommand("integrate")]
    | Annotated[Convert, tyro.conf.subcommand("convert")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Intensities, tyro.conf.subcommand("intensities")]
    | Annotated[Mask, tyro.conf.subcommand("mask")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Table, tyro.conf.subcommand("table")]
    | Annotated[Figure, tyro.conf.subcommand("figure")]
    | Annotated[Figure, tyro.conf.subcommand("figure")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Methods, tyro.conf.subcommand("methods")]
)


def listed(text: str) -> list[str]:
    """The names in `a,b`."""
    return [name.strip() for name in text.split(",") if name.strip()]


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a part failed, 2 wrong input or options, 130 interrupted."""
    try:
        command = tyro.cli(
            Command,  # pyright: ignore[reportArgumentType]
            prog="photonormal",
            description="Surface normals, depth and meshes from photographs under known lights.",
            args=arguments,
        )
        return command()
    except InputError as error:
        print(f"photonormal: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
