"""Commands from normal maps: scored, integrated, in another frame or format."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from tyro.conf import OmitArgPrefixes, Positional

from photonormal.cli.kinds import File, Millimetres, tell
from photonormal.cli.photographs import Layout
from photonormal.options import Frame
from photonormal.types import Capture, InputError, Normals


@dataclass(frozen=True)
class Reading:
    """What the numbers of the normal map mean, where its file does not say."""

    channels: Literal["auto", "xyz", "xy", "wy"] = "auto"
    """Which channels hold x, y and z: xyz (red, green, blue), xy, or wy (alpha and green). xy and wy compute z."""
    partial: bool = False
    """Go on although fewer than 90 % of the object's pixels hold a normal."""

    def normals(self, path: Path, frame: str, mask: Path | None = None) -> Normals:
        """Those of a file or a result folder; what is found out about them is printed."""
        from photonormal.capture.images import read_mask
        from photonormal.export import load_normals

        shown = None if mask is None else read_mask(mask)
        return load_normals(path, frame, self.channels, shown, self.partial, tell)


MapFrame = Literal["auto", "opengl", "directx", "y-down", "z-away", "blender"]


@dataclass(frozen=True)
class Score:
    """Print the angular error of a result against the true normals of its capture."""

    capture: Positional[Path]
    """Capture that holds its true normals."""
    result: Positional[Path]
    """Folder that `measure` wrote, or a normal map (.npz, .npy, .mat, or a picture)."""
    format: Layout = "auto"
    """Layout of the capture; auto: recognised by its files."""
    frame: MapFrame = "auto"
    """Frame of the result's normals; auto: as the file says, else found from the normals."""
    json: bool = False
    """Print one JSON object."""
    reading: OmitArgPrefixes[Reading] = Reading()

    def __call__(self) -> int:
        from photonormal.capture import load
        from photonormal.scoring import score

        known = load(self.capture, format=self.format)
        if known.truth is None:
            raise InputError(f"{self.capture} has no true normals to score against; add Normal_gt.mat.")
        result = score(self.reading.normals(self.result, self.frame), known.truth).as_dict()
        lights = scored_lights(known, self.result)
        if self.json:
            print(json.dumps(result | ({"lights": lights} if lights else {})))
        else:
            print(
                f"mean {result['mean_deg']:.2f}, median {result['median_deg']:.2f} degrees; "
                f"{result['below_15']:.1f} % below 15, {result['below_30']:.1f} % below 30 ({result['pixels']} pixels)"
            )
            if lights:
                percent = f", intensities {lights['intensity_percent']:.1f} %" if "intensity_percent" in lights else ""
                print(f"lights: mean {lights['mean_deg']:.2f}, at most {lights['most_deg']:.2f} degrees{percent}")
        return 0


def scored_lights(known: Capture, result: Path) -> dict[str, float] | None:
    """How wrong the lights are that a result folder's report says were found; None where there are none."""
    from photonormal.capture import intensities_of
    from photonormal.export.folder import listed_files
    from photonormal.scoring.lights import score_lights
    from photonormal.view.result import report_of

    if listed_files(result) is None or known.lights is None or (found := report_of(result).get("found_lights")) is None:
        return None
    e = found.get("intensities")
    directions = np.array(found["directions"], float).reshape(-1, 3)
    true = None if e is None else intensities_of(known)
    return score_lights(directions, known.lights, None if e is None else np.array(e, float), true).as_dict()


def refuse_unwritable(out: Path, overwrite: bool, *read: Path | None) -> None:
    """InputError where the file can't be written: it exists without `overwrite`, is read, or belongs to a result."""
    from photonormal.disk import refuse_taken
    from photonormal.export.folder import result_files

    refuse_taken([out], overwrite, [p for p in read if p is not None], result_files(out.parent))


@dataclass(frozen=True)
class Integrate:
    """Turn a normal map into depth, heights or a mesh."""

    normals: Positional[Path]
    """Normal map (.npz, .npy, .mat, or a picture), or a folder that `measure` wrote."""
    out: Path
    """File to write: .npz (depth), .png or .tif (16-bit heights), .exr (heights), .ply, .obj, .glb or .stl (mesh)."""
    method: Literal["simchony", "quadratic", "bilateral"] = "quadratic"
    """simchony is fastest where the mask nearly fills the picture; bilateral lets the depth jump at edges."""
    tile: bool = False
    """The map repeats: its right edge meets its left one, and its lower edge its upper one. Leave --method out then."""
    mask: File = None
    """Picture that is white on the part to integrate."""
    mm_per_px: Millimetres = None
    """Width of a pixel in mm: the file is then in millimetres instead of pixels."""
    camera: File = None
    """Text file with the 3 x 3 camera matrix in pixels, for a perspective view."""
    albedo: File = None
    """Picture with the colours of a mesh; by default that of the result folder."""
    frame: MapFrame = "auto"
    """Frame of the map: opengl (green up), directx (green down), y-down (and z away), z-away (green up) or blender.
    blender: world space seen from the front, y away and z up. auto: as the file says, else found from the normals."""
    overwrite: bool = False
    """Replace a file that exists."""
    reading: OmitArgPrefixes[Reading] = Reading()

    def __call__(self) -> int:
        from photonormal.export import save
        from photonormal.export.pictures import read_colours
        from photonormal.integration import integrate
        from photonormal.measurement import read_camera
        from photonormal.progress import progress

        refuse_unwritable(self.out, self.overwrite, self.normals, self.mask, self.albedo)
        if self.tile and self.method != "quadratic":
            raise InputError(f"--tile and --method {self.method} came but a tile has a method of its own; give one.")
        normals = self.reading.normals(self.normals, self.frame, self.mask)
        own = self.normals / "albedo.png"
        colours = self.albedo if self.albedo is not None else own if own.is_file() else None
        albedo = None if colours is None else read_colours(colours, normals.mask.shape)
        method = "periodic" if self.tile else self.method
        with progress(f"depth by {method}"):
            surface = integrate(normals, method, K=read_camera(self.camera))
        print(save(surface, self.out, normals, albedo, mm_per_px=self.mm_per_px))
        return 0


@dataclass(frozen=True)
class Convert:
    """Convert a normal map to another frame or file format."""

    normals: Positional[Path]
    """Normal map (.npz, .npy, .mat, or a picture), or a folder that `measure` wrote."""
    out: Path
    """File to write: .png (16-bit), .exr or .npz; it carries the name of its frame."""
    from_frame: MapFrame = "auto"
    """Frame of the map that is read, as for `integrate`; auto: as the file says, else found from the normals."""
    frame: Annotated[Frame, tyro.conf.arg()] = "opengl"
    """Frame of the map that is written: opengl (green up), directx (green down), y-down, z-away or blender."""
    mask: File = None
    """Picture that is white where normals are kept."""
    overwrite: bool = False
    """Replace a file that exists."""
    reading: OmitArgPrefixes[Reading] = Reading()

    def __call__(self) -> int:
        from photonormal.export import save

        refuse_unwritable(self.out, self.overwrite, self.normals, self.mask)
        print(save(self.reading.normals(self.normals, self.from_frame, self.mask), self.out, frame=self.frame))
        return 0
