"""Commands to look at results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from photonormal.cli.kinds import Folder, Millimetres
from photonormal.options import Port


@dataclass(frozen=True)
class View:
    """A page in the browser to relight, turn, measure and compare results, or to mark photographs; Ctrl-C ends it."""

    folders: Positional[tuple[Path, ...]]
    """Folders that `measure` wrote; or one folder of photographs, to mark its mask, a sphere, pictures to leave out."""
    capture: Folder = None
    """The photographs of the first result, where they are no longer where its report says."""
    mm_per_px: Millimetres = None
    """Millimetres that a pixel is wide, so that lengths are told in mm."""
    port: Port = 0
    """Port on 127.0.0.1; 0: a free one."""
    browser: bool = True
    """Open a browser; its address is printed in either case."""

    def __call__(self) -> int:
        from photonormal.view.server import open_pages

        open_pages(self.folders, self.capture, self.mm_per_px, port=self.port, browser=self.browser)
        return 0


@dataclass(frozen=True)
class Export:
    """A result as one HTML file, to relight, turn and measure it without server or network."""

    result: Positional[Path]
    """Folder that `measure` wrote."""
    page: Path
    """File to write, .html."""
    capture: Folder = None
    """Its photographs, where they are no longer where its report says."""
    mm_per_px: Millimetres = None
    """Millimetres that a pixel is wide, so that lengths are told in mm."""
    overwrite: bool = False
    """Replace a file that exists."""

    def __call__(self) -> int:
        from photonormal.view import export_page

        path, reduced = export_page(self.result, self.page, self.capture, self.mm_per_px, self.overwrite)
        print(path)
        if reduced > 1:
            print(f"The result is larger than 6 megapixels: the file holds it at 1/{reduced} of its size.")
        return 0
