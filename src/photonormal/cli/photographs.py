"""Options that say how photographs are read: which they are, where their lights are, what is corrected."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import OmitArgPrefixes

from photonormal.capture import FORMATS
from photonormal.cli.kinds import (
    Degrees,
    File,
    FileOrFolder,
    Millimetres,
    Number,
    Numbers,
    Pixels,
    Size,
    shown,
)
from photonormal.options import DrawnOn, Frame, Scale

Layout = Annotated[str, tyro.conf.arg(metavar=f"{{{','.join(('auto', *FORMATS))}}}")]


@dataclass(frozen=True)
class Files:
    """Which photographs."""

    images: Numbers = ""
    """Subset of the photographs by number, such as 1-10,15; all by default."""
    mask: File = None
    """Mask picture, white on the object, instead of the capture's own."""
    mask_on: Annotated[DrawnOn, shown("{stored,shown}")] = ""
    """What a mask was drawn on where Exif's orientation turns the photographs: stored samples, or what viewers show."""
    format: Layout = "auto"
    """Layout of the capture, where its content does not tell."""
    prefer: Annotated[Literal["", "raw", "jpeg", "tiff", "png", "exr"], shown("{raw,jpeg,tiff,png,exr}")] = ""
    """Which file to take where each photograph is there in two kinds."""
    rgb_lights: bool = False
    """Each photograph shows three lights at a time: one in red, one in green and one in blue."""
    crop: Annotated[str, shown("X,Y,WIDTH,HEIGHT")] = ""
    """Part of the photographs to read, in pixels; without it what crop.txt beside them says, or all."""
    scale: Annotated[Scale, tyro.conf.arg(metavar="FACTOR")] = 1.0
    """By which photographs are reduced for a first look: 0.5 halves both sides."""
    memory: Size = ""
    """How much memory may be used, such as 3GB; half of what is free by default."""


@dataclass(frozen=True)
class LightOptions:
    """Where the lights are, and how bright."""

    lights: File = None
    """File with light directions, instead of the capture's own: .lp, .csv, .txt, .npy, .npz, .mat, .dome, .relight,
    .json; or `unknown`: directions and intensities are found from the photographs."""
    lights_as: Annotated[
        Literal["", "directions", "angles", "azimuth-elevation"], shown("{directions,angles,azimuth-elevation}")
    ] = ""
    """What its numbers are: directions x, y, z, or angles in degrees: slant and tilt, or azimuth and elevation."""
    frame: Frame = "opengl"
    """Frame of the directions: opengl (y up, z to the camera), directx (y down), y-down (and z away), z-away (y up), or
    blender (y away, z up)."""
    ring: Number = None
    """Lamps at equal steps around the object, in the photographs' order, instead of a file; with --elevation."""
    elevation: Degrees = None
    """How far the lamps of --ring stand over the plane of the picture: 90 is at the camera."""
    start: Annotated[float, tyro.conf.arg(metavar="DEGREES")] = 0.0
    """Where the first lamp of --ring is: 0 at the right of the picture, 90 at its top."""
    clockwise: bool = False
    """The lamps of --ring go round clockwise in the picture, rather than counter-clockwise."""
    intensities: File = None
    """File with light intensities, instead of the capture's own."""
    exif_exposure: bool = False
    """Divide by the exposures that the photographs tell in their Exif data."""
    mm_per_px: Millimetres = None
    """Millimetres that a pixel is wide on the object: lights are near, and their file holds positions in mm."""
    dome_radius_mm: Millimetres = None
    """Lamps are this far from the object at the picture's middle, in their file's directions; with --mm-per-px."""
    focal_px: Pixels = None
    """Focal length in pixels, for a camera near the object; with --mm-per-px."""


@dataclass(frozen=True)
class Corrections:
    """What is done to the photographs' samples."""

    srgb: bool = False
    """The photographs are sRGB-encoded and have to be linearised; by default their profile or Exif data is believed."""
    linear: bool = False
    """They are linear, whatever their profile or Exif data says."""
    dark: File = None
    """Picture taken with all lights off, which is subtracted: ambient light and the sensor's black."""
    flat: FileOrFolder = None
    """Picture of an even white surface, by which the photographs are divided: vignetting and dust; or a folder with one
    of a white or grey board for each light: also how its light falls off, and how bright it is."""
    hot_pixels: bool = False
    """Replace pixels that stand out of their surroundings in the dark picture, or in all photographs."""
    lens: File = None
    """Lens calibration that OpenCV wrote (.yml), whose distortion is taken out."""


@dataclass(frozen=True)
class Photographs:
    """How the photographs are read."""

    capture: OmitArgPrefixes[Files] = Files()
    lights: OmitArgPrefixes[LightOptions] = LightOptions()
    corrections: OmitArgPrefixes[Corrections] = Corrections()

    def how(self) -> dict[str, Any]:
        """The options by name, as `photonormal.load` takes them."""
        return asdict(self.capture) | asdict(self.lights) | asdict(self.corrections)


Read = Annotated[Photographs, tyro.conf.arg(name="")]
