"""Commands from photographs to results."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from photonormal.options import Count, Device, Positive, Precision
from photonormal.solve import DEFAULT, METHODS, method_class, parse
from photonormal.types import InputError, printable


@dataclass(frozen=True)
class Photographs:
    """How the photographs are read."""

    images: str = ""
    """Subset of the photographs by number, such as 1-10,15; all by default."""
    format: str = "auto"
    """Layout of the capture, when its content does not tell: diligent, rti, folder, ..."""
    lights: Path | None = None
    """File with light directions, instead of the capture's own: .lp, .csv, .txt, .npy, .mat, .dome, .relight, .json."""
    lights_as: Literal["", "directions", "angles", "azimuth-elevation"] = ""
    """What its numbers are: directions x, y, z, or angles in degrees: slant and tilt, or azimuth and elevation."""
    ring: Count | None = None
    """Lamps at equal steps around the object, in the photographs' order, instead of a file; with --elevation."""
    elevation: float | None = None
    """How many degrees the lamps of --ring stand over the plane of the picture: 90 is at the camera."""
    start: float = 0.0
    """Where the first lamp of --ring is, in degrees: 0 at the right of the picture, 90 at its top."""
    clockwise: bool = False
    """The lamps of --ring go round clockwise in the picture, rather than counter-clockwise."""
    rgb_lights: bool = False
    """Each photograph shows three lights at a time: one in red, one in green and one in blue."""
    prefer: Literal["", "raw", "jpeg", "tiff", "png", "exr"] = ""
    """Which file to take where each photograph is there in two kinds: raw, jpeg, tiff, png or exr."""
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
    """Picture of an even white surface, by which the photographs are divided: vignetting and dust; or a folder with one
    of a white or grey board for each light: also how its light falls off, and how bright it is."""
    hot_pixels: bool = False
    """Replace pixels that stand out of their surroundings in the dark picture, or in all photographs."""
    lens: Path | None = None
    """Lens calibration that OpenCV wrote (.yml), whose distortion is taken out."""
    mm_per_px: Positive | None = None
    """Millimetres that a pixel is wide on the object: lights are near, and their file holds positions in mm."""
    dome_radius_mm: Positive | None = None
    """Lamps are this far from the object's middle, in the directions that their file holds; with --mm-per-px."""
    focal_px: Positive | None = None
    """Focal length in pixels, for a camera near the object; with --mm-per-px."""
    memory: str = ""
    """How much memory may be used, such as 3GB; half of what is free by default."""


Read = Annotated[Photographs, tyro.conf.arg(name="")]


@dataclass(frozen=True)
class Measure:
    """Normals, albedo, depth and mesh of one object from its photographs."""

    capture: Positional[Path]
    """Folder with photographs and lights, an .lp file, or `demo`: the capture that comes with photonormal."""
    out: Path
    """Folder for the results; it is written whole or not at all."""
    method: str = DEFAULT
    """One of `photonormal methods`, with options if need be, such as normalnet:rotations=4."""
    device: Device = "auto"
    """auto, cpu or cuda."""
    precision: Precision = "auto"
    """What networks compute in: float32 or bf16; auto: bf16 where the machine has instructions for it."""
    normals_frame: str = "opengl"
    """Frame of normals.png: opengl (green up), directx (green down) or y-down (and z away from the camera)."""
    integration: str = "quadratic"
    """How depth is found: simchony, quadratic or bilateral."""
    camera: Path | None = None
    """Text file with the 3 x 3 camera matrix in pixels, for a perspective surface."""
    mesh: bool = True
    """Write depth and mesh."""
    expected_error: bool = True
    """Tell how far each normal is expected to be off."""
    overwrite: bool = False
    """Write into a folder that exists and is no result of photonormal."""
    read: Read = Photographs()

    def __call__(self) -> int:
        from photonormal.capture import files_read, load, told
        from photonormal.export.folder import whole_folder
        from photonormal.export.result import write_result
        from photonormal.geometry import known_frame
        from photonormal.measure import measure, read_camera

        method, options = parse(self.method)
        known_frame(self.normals_frame)
        K, how = read_camera(self.camera), asdict(self.read)
        capture = load(self.capture, **how)
        with whole_folder(
            self.out, self.overwrite, files_read(self.capture, capture, self.camera, *how.values())
        ) as folder:
            result = measure(
                capture,
                method,
                device=self.device,
                options=options,
                integration=self.integration if self.mesh else None,
                K=K,
                expected_error=self.expected_error,
                precision=self.precision,
            )
            report = write_result(result, folder, self.normals_frame, told(self.capture, how))
        for warning in report["warnings"]:
            print(f"photonormal: warning: {printable(warning)}", file=sys.stderr)
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
        from photonormal.disk import refuse_taken
        from photonormal.export import load_normals, save
        from photonormal.integrate import integrate
        from photonormal.measure import read_camera
        from photonormal.progress import progress

        refuse_taken([self.out], self.overwrite)
        normals = load_normals(self.normals, self.frame)
        with progress(f"depth by {self.method}"):
            surface = integrate(normals, self.method, K=read_camera(self.camera))
        print(save(surface, self.out, normals))
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
        from photonormal.disk import refuse_taken
        from photonormal.export import load_normals, save

        refuse_taken([self.out], self.overwrite)
        print(save(load_normals(self.normals, self.from_frame), self.out, frame=self.frame))
        return 0


@dataclass(frozen=True)
class Methods:
    """The methods that `measure` knows, with a line about each."""

    def __call__(self) -> int:
        width = max(map(len, METHODS))
        for name in METHODS:
            summary = sys.modules[method_class(name).__module__].__doc__ or ""
            print(f"{name:{width}}  {summary.strip().splitlines()[0]}")
        return 0
