"""Options that say how photographs are read: which they are, where their lights are, what is corrected."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
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
    """Which photographs are read."""

    images: Numbers = ""
    """Numbers of the photographs to use, such as 1-10,15; all by default."""
    mask: File = None
    """Mask, white on the object; used instead of the capture's own."""
    mask_on: Annotated[DrawnOn, shown("{stored,shown}")] = ""
    """Whether the mask was drawn on the stored pictures, or on pictures that viewers turn by Exif's orientation."""
    format: Layout = "auto"
    """Layout of the capture; auto: recognised by its files."""
    prefer: Annotated[Literal["", "raw", "jpeg", "tiff", "png", "exr"], shown("{raw,jpeg,tiff,png,exr}")] = ""
    """Which kind of file to read where each photograph exists in two, such as RAW and JPEG."""
    rgb_lights: bool = False
    """Each photograph shows three lights at once: one in red, one in green and one in blue."""
    crop: Annotated[str, shown("X,Y,WIDTH,HEIGHT")] = ""
    """Part of the photographs to read, in pixels; by default the part that crop.txt names, else all."""
    scale: Annotated[Scale, tyro.conf.arg(metavar="FACTOR")] = 1.0
    """Reduce the photographs for a first look: 0.5 halves both sides."""
    memory: Size = ""
    """Memory to use, such as 3GB; by default half of the free memory."""


@dataclass(frozen=True)
class LightOptions:
    """Where the lights are, and how bright."""

    lights: File = None
    """File with light directions (.lp, .csv, .txt, .npy, .npz, .mat, .dome, .relight, .json), not the capture's own.
    `unknown`: directions and intensities are found from the photographs."""
    lights_as: Annotated[
        Literal["", "directions", "angles", "azimuth-elevation"], shown("{directions,angles,azimuth-elevation}")
    ] = ""
    """What the numbers in that file are: x, y, z; or, in degrees, slant and tilt (angles), or azimuth and elevation."""
    frame: Frame = "opengl"
    """Frame of the directions: opengl (y up, z to the camera), directx (y down), y-down (and z away), z-away, blender.
    z-away: y is up. blender: y is away and z is up."""
    ring: Number = None
    """No file: N lamps stand at equal steps around the object, in the photographs' order; needs --elevation."""
    elevation: Degrees = None
    """Angle of the lamps of --ring above the object's plane: 90 is at the camera."""
    start: Annotated[float, tyro.conf.arg(metavar="DEGREES")] = 0.0
    """Where the first lamp of --ring stands: 0 is at the right of the picture, 90 at its top."""
    clockwise: bool = False
    """The lamps of --ring follow each other clockwise in the picture."""
    intensities: File = None
    """File with light intensities, used instead of the capture's own."""
    exif_exposure: bool = False
    """Divide each photograph by the exposure in its Exif data."""
    mm_per_px: Millimetres = None
    """Width of a pixel on the object in mm. It makes the lights near ones, and their file holds positions in mm."""
    dome_radius_mm: Millimetres = None
    """The file holds directions, and all lamps are this far from the middle of the object; needs --mm-per-px."""
    focal_px: Pixels = None
    """Focal length in pixels, for a camera near the object; needs --mm-per-px."""


@dataclass(frozen=True)
class Corrections:
    """How brightnesses are corrected."""

    srgb: bool = False
    """The photographs are sRGB-encoded, so linearise them; by default their profile or Exif data decides."""
    linear: bool = False
    """The photographs are linear, whatever their profile or Exif data says."""
    dark: File = None
    """Picture taken with all lights off. It is subtracted, which removes ambient light and the sensor's black level."""
    flat: FileOrFolder = None
    """Picture of an even white surface. The photographs are divided by it, which removes vignetting and dust.
    FOLDER: a picture of a white or grey board for each light, which also removes fall-off and intensities."""
    hot_pixels: bool = False
    """Replace pixels that stand out from their neighbours in the --dark picture, or else in all photographs."""
    lens: File = None
    """Lens calibration by OpenCV (.yml); its distortion is removed."""


@dataclass(frozen=True)
class Photographs:
    """How the photographs are read."""

    capture: OmitArgPrefixes[Files] = Files()
    lights: OmitArgPrefixes[LightOptions] = LightOptions()
    corrections: OmitArgPrefixes[Corrections] = Corrections()

    def how(self) -> dict[str, Any]:
        """The options by name, as `photonormal.load` takes them."""
        return asdict(self.capture) | asdict(self.lights) | asdict(self.corrections)

    def having(self, options: dict[str, Any]) -> Photographs:
        """The same with those options, by name, whichever group they are of."""
        groups = {"capture": self.capture, "lights": self.lights, "corrections": self.corrections}
        return replace(
            self, **{g: replace(v, **{k: options[k] for k in options if hasattr(v, k)}) for g, v in groups.items()}
        )


Read = Annotated[Photographs, tyro.conf.arg(name="")]
