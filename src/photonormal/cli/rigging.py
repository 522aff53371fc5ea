"""Commands about the rig: which way the lights are, how bright they are, whether the photographs can be trusted."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tyro.conf import Positional

from photonormal.cli.measuring import Photographs, Read
from photonormal.options import Count, Positive
from photonormal.types import printable


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
    count: Count = 1
    """Spheres that each photograph shows."""
    focal_px: Positive | None = None
    """Focal length in pixels, for spheres near the camera; a camera far away without it."""
    radius_mm: Positive | None = None
    """The spheres' radius; with two or more in one frame the lights' positions are found too."""
    frame: str = "opengl"
    """Frame of what is written: opengl (y up, z to the camera), directx (y down) or y-down (and z away)."""
    skip: str = ""
    """Photographs to leave out, of the object and the sphere: numbers and ranges from 1, such as 3,7-9."""
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
            skip=self.skip,
            overwrite=self.overwrite,
        )
        for warning in report["warnings"]:
            print(f"photonormal: warning: {printable(warning)}", file=sys.stderr)
        for sphere in report["spheres"]:
            c = sphere["circle"]
            print(
                f"{sphere['folder']}: sphere at ({c['x']:.1f}, {c['y']:.1f}), radius {c['r']:.1f} px, "
                f"confidence {c['confidence']:.2f} ({sphere['confidence']})"
            )
        print(f"{len(report['lights'])} lights: {', '.join(report['files'])}")
        return 0


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
    read: Read = field(default_factory=Photographs)

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
class Check:
    """What is wrong with a capture, before it is measured: exposure, lights, motion, and what to do."""

    capture: Positional[Path]
    """Folder with photographs and lights, an .lp file, or `demo`."""
    out: Path | None = None
    """Folder for a report, a polar plot of the lights, and corrected lights where other ones fit the photographs."""
    overwrite: bool = False
    """Write into a folder that exists and is no result of photonormal."""

    read: Read = field(default_factory=Photographs)

    def __call__(self) -> int:
        from photonormal.rig import check

        found, files = check(
            self.capture,
            self.out,
            overwrite=self.overwrite,
            **asdict(self.read),
        )
        for finding in found:
            print(f"{'grave' if finding.grave else 'note'}: {finding.kind}: {printable(finding.message)}")
        if not found:
            print("nothing wrong was found")
        if files:
            print(", ".join(str(f) for f in files))
        return 0
