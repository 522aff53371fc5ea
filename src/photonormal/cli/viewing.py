"""Commands to look at results."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from photonormal.cli.kinds import File, FileOrFolder, Folder, Millimetres, Size, shown, tell
from photonormal.options import Port
from photonormal.types import InputError


@dataclass(frozen=True)
class View:
    """Open a page to relight, turn, measure and compare results, or to mark photographs; Ctrl-C ends it."""

    folders: Positional[Annotated[tuple[Path, ...], shown("FOLDER")]]
    """Folders that `measure` wrote; or a folder of photographs, to draw a mask, mark a sphere or leave pictures out."""
    capture: Folder = None
    """Where the photographs of the first result are now, if they were moved."""
    mm_per_px: Millimetres = None
    """Width of a pixel in mm: the page then shows lengths in mm."""
    port: Port = 0
    """Port on 127.0.0.1; 0 takes a free one."""
    browser: bool = True
    """Open a browser; the address is printed in either case."""

    def __call__(self) -> int:
        from photonormal.view.server import open_pages

        open_pages(self.folders, self.capture, self.mm_per_px, port=self.port, browser=self.browser)
        return 0


@dataclass(frozen=True)
class Export:
    """Write results as an HTML page (--page), for other programs (--to), or as relit pictures (--relit, --sweep)."""

    results: Positional[Annotated[tuple[Path, ...], shown("RESULT")]]
    """Folder that `measure` wrote. Several, or the folder of a batch, are written into the folder --out, one by one."""
    page: File = None
    """HTML file to write: a page to relight, turn and measure the result. It needs no server and no network."""
    to: Annotated[str, shown("FORMAT")] = ""
    """Format of --out.
    Relightable files for RTIViewer and the like: ptm (.ptm, luminance and colour), ptm-rgb; hsh (.rti, 9 terms), hsh16.
    Relightable folders for the web: relight, relight-hsh (RelightLab's); with a page: openlime, openlime-hsh.
    For 3D programs: gltf (.glb: mesh, colour, normal map, occlusion); maps (a folder of pictures for materials)."""
    out: FileOrFolder = None
    """File or folder to write with --to, --relit and --sweep; for several results, a folder that gets one for each."""
    relit: Annotated[str, shown("AZIMUTH,ELEVATION")] = ""
    """Write a picture (.png, .jpg) under a light from this direction: 0,30 is from the right, 90,30 from above."""
    sweep: bool = False
    """Write a film (.mp4, .gif) of a light that goes around once; it starts at 0,45 or where --relit says."""
    by: Literal["hsh", "ptm", "hsh16", "matt"] = "hsh"
    """What --relit and --sweep draw: a fit to the photographs; or matt: normals and albedo, without cast shadows."""
    webp: bool = False
    """For openlime: write tiles as lossless WebP instead of JPEG."""
    program: Literal["blender", "substance", "unreal"] = "blender"
    """For maps: the program whose file names are used; green is up for blender and down for the others."""
    exr: bool = False
    """For maps: colour, normals and height as OpenEXR, linear floats; the .json names the unit of the heights."""
    texture: Annotated[int, shown("PIXELS")] = 8192
    """For gltf: longest side of its pictures."""
    tile: bool = False
    """For maps: make them repeat, right edge to left edge and lower edge to upper edge."""
    capture: Folder = None
    """Where the photographs of the result are now, if they were moved."""
    mm_per_px: Millimetres = None
    """Width of a pixel in mm: page and maps then give lengths in mm, and gltf is in metres."""
    memory: Size = ""
    """Memory to use, such as 3GB; by default half of the free memory."""
    overwrite: bool = False
    """Replace a file that exists, or write into a folder that holds other files."""

    def __call__(self) -> int:
        relit = bool(self.relit) or self.sweep
        if (self.page is not None) + bool(self.to) + relit != 1 or (self.page is None) == (self.out is None):
            raise InputError(
                "give --page FILE.html, or --to FORMAT, --relit AZIMUTH,ELEVATION or --sweep with --out FILE; one of "
                "them is needed."
            )
        for given, option, taken, by in (
            (self.tile, "--tile", self.to == "maps", "--to maps"),
            (self.program != "blender", "--program", self.to == "maps", "--to maps"),
            (self.exr, "--exr", self.to == "maps", "--to maps"),
            (self.texture != Export.texture, "--texture", self.to == "gltf", "--to gltf"),
            (self.webp, "--webp", self.to.startswith("openlime"), "--to openlime"),
            (self.by != Export.by, "--by", relit, "--relit or --sweep"),
        ):
            if given and not taken:
                raise InputError(f"{option} came without {by}, but works only with it; leave it out.")
        from photonormal.files.memory import allow
        from photonormal.view.result import is_result

        allow(self.memory)
        if len(self.results) != 1 or (self.out is not None and self.capture is None and not is_result(self.results[0])):
            return self._several()
        if self.out is not None:
            print(self._handed_on(self.results[0], self.out))
            return 0
        from photonormal.view import export_page

        assert self.page is not None
        path, reduced = export_page(self.results[0], self.page, self.capture, self.mm_per_px, self.overwrite)
        print(path)
        if reduced > 1:
            print(f"The result is larger than 6 megapixels: the file holds it at 1/{reduced} of its size.")
        return 0

    def _several(self) -> int:
        """Each result by itself: what can't be written of one is reported, and the others go on."""
        from photonormal.handover.many import ending_of, results_in

        if self.out is None or self.capture is not None:
            option, which = ("--page", "page") if self.out is None else ("--capture", "folder of photographs")
            raise InputError(
                f"{len(self.results)} folders came but a {which} is one result's; give {option} with that."
            )
        found, failed = results_in(self.results), 0
        ending = ending_of(self.to, self.sweep, self.out, found.results)
        if found.without:
            tell(f"left out, since they have no result: {', '.join(found.without)}")
        for name, result in found.results.items():
            try:
                print(self._handed_on(result, self.out / f"{name}{ending}"), flush=True)
            except InputError as error:
                failed += 1
                tell(f"{name}: {error}")
        return 1 if failed else 0

    def _handed_on(self, result: Path, out: Path) -> Path:
        if self.to == "gltf":
            from photonormal.handover.gltf import export_gltf

            path, reduced = export_gltf(result, out, self.mm_per_px, self.overwrite, texture=self.texture)
            if reduced > 1:
                tell(f"The pictures are reduced to {self.texture} pixels, 1/{reduced:.2g} of the result's size.")
            return path
        if self.to == "maps":
            from photonormal.handover.maps import export_maps

            path = export_maps(result, out, self.program, self.tile, self.mm_per_px, self.overwrite, self.exr)
            if not (result / "roughness.png").is_file():
                tell("the result has no roughness and no metalness; `photonormal measure --materials` finds them.")
            return path
        if self.to:
            from photonormal.handover.relightable import export_relighting

            path = export_relighting(result, self.to, out, self.capture, self.overwrite, self.webp)
            if self.to.startswith("openlime"):
                folder = shlex.quote(str(path))
                tell(f"Browsers open it from a web server alone, such as: python -m http.server --directory {folder}")
            return path
        from photonormal.handover.relit import export_relit

        return export_relit(result, out, self.relit, self.sweep, self.by, self.capture, self.overwrite)
