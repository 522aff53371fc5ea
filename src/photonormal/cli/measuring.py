"""Commands from photographs to results."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import Positional

from photonormal.options import Count, Device, Frame, Positive, Precision
from photonormal.solve import DEFAULT, METHODS, method_class, parse
from photonormal.types import printable


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
    normals_frame: Frame = "opengl"
    """Frame of normals.png, which tells it: opengl (green up), directx (green down), y-down, z-away or blender."""
    integration: str = "quadratic"
    """How depth is found: simchony, quadratic or bilateral."""
    camera: Path | None = None
    """Text file with the 3 x 3 camera matrix in pixels, for a perspective surface."""
    mesh: bool = True
    """Write depth and mesh."""
    expected_error: bool = True
    """Tell how far each normal is expected to be off."""
    linear_albedo: bool = False
    """Write albedo.png without the sRGB curve."""
    overwrite: bool = False
    """Write into a folder that exists and is no result of photonormal."""
    read: Read = Photographs()

    def __call__(self) -> int:
        from photonormal.capture import files_read, load, told
        from photonormal.export.folder import whole_folder
        from photonormal.export.result import write_result
        from photonormal.measure import measure, read_camera

        method, options = parse(self.method)
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
            report = write_result(result, folder, self.normals_frame, told(self.capture, how), self.linear_albedo)
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
class Methods:
    """The methods that `measure` knows, with a line about each."""

    def __call__(self) -> int:
        width = max(map(len, METHODS))
        for name in METHODS:
            summary = sys.modules[method_class(name).__module__].__doc__ or ""
            print(f"{name:{width}}  {summary.strip().splitlines()[0]}")
        return 0
