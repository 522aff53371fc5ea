"""A result folder as the page shows it: its layers, its lights, and the photographs where they are at hand."""

from __future__ import annotations

import os
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any, NotRequired, TypedDict

import numpy as np

from photonormal.capture import DEMO, load
from photonormal.capture.images import MARGIN
from photonormal.disk import recover
from photonormal.export import load_normals
from photonormal.export.folder import REPORT
from photonormal.export.heights import read_depth
from photonormal.export.mesh import display
from photonormal.export.pictures import read_albedo
from photonormal.lighting import frontal, under
from photonormal.masked import box_of
from photonormal.options import NotNegative, Positive, Scale, Whole, check_value
from photonormal.scoring import error_map_deg
from photonormal.stored import read_json
from photonormal.types import Capture, InputError, Normals, Surface, in_pixels
from photonormal.view.planes import Plane, degrees_plane, height_plane, normals_plane, plane

AGAIN = "measure again"
KEPT = 4  # photographs that stay decoded


class Reduced(TypedDict):
    """By how much the photographs were."""

    scale: Scale


class StoredLights(TypedDict):
    """Lights that were found from the photographs."""

    directions: list[tuple[float, float, float]]
    intensities: NotRequired[list[Positive]]


class StoredReport(TypedDict):
    """What is read of a result's report; the rest of it may be anything."""

    capture: NotRequired[str]
    method: NotRequired[str]
    lights: NotRequired[Whole]
    source: NotRequired[str]
    reading: NotRequired[dict[str, Any]]
    expected_error_deg: NotRequired[NotNegative]
    warnings: NotRequired[list[str]]
    crop: NotRequired[Reduced | None]
    found_lights: NotRequired[StoredLights]


@dataclass
class PicturePlanes:
    """The capture's pictures as planes of colours, decoded when they are asked for."""

    capture: Capture
    box: tuple[slice, slice]
    white: float
    _kept: OrderedDict[int, Plane] = field(default_factory=OrderedDict)
    _lock: Lock = field(default_factory=Lock)

    def __len__(self) -> int:
        return self.capture.images.shape[0]

    def __getitem__(self, j: int) -> Plane:
        with self._lock:
            if j not in self._kept:
                image = self.capture.images[j][self.box] / self.white  # (h, w, 1 or 3)
                self._kept[j] = plane("colour", display(np.broadcast_to(image, (*image.shape[:2], 3))))
                if len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(j)
            return self._kept[j]


@dataclass(frozen=True)
class ViewedResult:
    """One result, cut to the object's box.

    Parameters
    ----------
    layers : name -> plane: normals, albedo, height, expected, error, as far as the folder has them
    about : what the page gets of it besides the tiles, values of JSON
    photographs : None where the capture is not at hand
    """

    layers: dict[str, Plane]
    about: dict[str, Any]
    photographs: PicturePlanes | None

    def tile(self, layer: str, level: int, x: int, y: int) -> bytes:
        """A tile of a layer, or of photograph j as "photograph-j"; KeyError or IndexError where there is none."""
        if layer.startswith("photograph-"):
            j = int(layer.removeprefix("photograph-"))
            if self.photographs is None or not 0 <= j < len(self.photographs):
                raise IndexError
            return self.photographs[j].tile(level, x, y)
        return self.layers[layer].tile(level, x, y)


def is_result(folder: Path) -> bool:
    """True for a folder with a report and normals."""
    return (folder / REPORT).is_file() and (folder / "normals.npz").is_file()


def open_result(folder: str | Path, capture: str | Path | None = None, mm_per_px: float | None = None) -> ViewedResult:
    """A folder that `photonormal measure` wrote.

    Parameters
    ----------
    folder : the result
    capture : its photographs, where they are not where the report says
    mm_per_px : millimetres that a pixel is wide, where the report does not say

    Raises
    ------
    InputError
        If the folder is no result, or a file of it is cut short or of another size.
    """
    folder = Path(folder)
    report = report_of(folder)
    normals = load_normals(folder)
    albedo = surface = None
    if (folder / "albedo.png").is_file():
        albedo = read_albedo(folder / "albedo.png")
        _same_size(folder / "albedo.png", albedo.shape, normals.mask.shape)
    if (folder / "depth.npz").is_file():
        surface = read_depth(folder / "depth.npz")
        _same_size(folder / "depth.npz", surface.depth.shape, normals.mask.shape)
    photographs, missing = photographs_of(report, folder, capture, normals.mask.shape)
    if mm_per_px is None:
        mm_per_px = mm_per_px_of(report, folder)
    name = report.get("capture") or folder.resolve().name
    truth = None if photographs is None else photographs.truth
    shown = shown_of(name, normals, albedo, surface, truth, report, mm_per_px)
    shown.about["notes"] += [] if missing is None else [missing]
    return replace(shown, photographs=_add_photographs(shown.about, photographs, box_of(normals.mask, MARGIN)))


def shown_of(
    name: str,
    normals: Normals,
    albedo: np.ndarray | None,
    surface: Surface | None,
    truth: Normals | None,
    report: StoredReport | dict[str, Any],
    mm_per_px: float | None,
    white: float = 1.0,
    every: int = 1,
) -> ViewedResult:
    """What a measurement gave, without its photographs.

    Parameters
    ----------
    albedo : (h, w, 1 or 3) linear, shown white where it is `white`
    every : of so many rows and columns only one is shown
    """
    whole = box_of(normals.mask, MARGIN)
    box = slice(whole[0].start, whole[0].stop, every), slice(whole[1].start, whole[1].stop, every)
    map = normals.map[box]
    layers = {"normals": normals_plane(map)}
    about: dict[str, Any] = {}
    if albedo is not None:
        layers["albedo"] = plane("colour", display(np.broadcast_to(albedo[box] / np.float32(white), map.shape)))
    if surface is not None:
        heights = Surface(surface.depth[box], surface.mask[box], surface.K).heights_px() / every
        layers["height"], low, step = height_plane(heights)
        about["relief"] = {"low": low, "step": step}
    if normals.expected_error_deg is not None:
        layers["expected"] = degrees_plane(normals.expected_error_deg[box])
    if truth is not None:
        error = error_map_deg(normals, truth)
        layers["error"] = degrees_plane(error[box])
        if np.isfinite(error).any():
            about["mean_error_deg"] = round(float(np.nanmean(error)), 2)
    about |= {
        "title": f"{name}, {report.get('method') or 'normals'}",
        "method": report.get("method", ""),
        "lamps": report.get("lights", 0),
        "width": map.shape[1],
        "height": map.shape[0],
        "every": every,
        "size": [side.stop - side.start for side in (whole[1], whole[0])],
        "origin": [whole[1].start, whole[0].start],
        "sizes": [[level.shape[1], level.shape[0]] for level in layers["normals"].levels],
        "layers": {key: p.kind for key, p in layers.items()},
        "first": 0,
        "first_photograph": 0,
        "mm_per_px": mm_per_px and mm_per_px * every,
        "expected_error_deg": report.get("expected_error_deg"),
        "photographs": [],
        "notes": [f"Warning: {warning}" for warning in report.get("warnings", [])],
    }
    return ViewedResult(layers, about, None)


def report_of(folder: Path) -> StoredReport:
    """The report of a result folder; InputError where it is none."""
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; give one that `photonormal measure` wrote.")
    recover(folder)
    if not is_result(folder):
        inside = [p.name for p in sorted(folder.iterdir()) if p.is_dir() and is_result(p)]
        which = f"a result in it, such as {folder / inside[0]}" if inside else ""
        lacks = " and ".join(name for name in (REPORT, "normals.npz") if not (folder / name).is_file())
        raise InputError(f"{folder} holds no {lacks}; give {which or 'a folder that `photonormal measure` wrote'}.")
    return read_json(folder / REPORT, StoredReport, AGAIN)


def mm_per_px_of(report: StoredReport, folder: Path) -> float | None:
    """Millimetres that a pixel of a result is wide, where its report says."""
    width = report.get("reading", {}).get("mm_per_px")
    if width is None:
        return None
    check_value(width, Positive, f"{folder / REPORT}: mm_per_px")
    return width / (report.get("crop") or {"scale": 1.0})["scale"]


def _same_size(path: Path, shape: tuple[int, ...], frame: tuple[int, ...]) -> None:
    if shape[:2] != frame:
        raise InputError(f"{path} is {shape[:2]} but normals.npz beside it is {frame}; measure again.")


def photographs_of(
    report: StoredReport, folder: Path, given: str | Path | None, shape: tuple[int, ...]
) -> tuple[Capture | None, str | None]:
    """The photographs that were measured into a folder, or why they are left out. What the user named must fit."""
    source = given if given is not None else report.get("source")
    if source is None:
        return None, "The report does not say where the photographs are; name them with --capture."
    if source == "demo":
        source = DEMO
    try:
        found = load(source, **_reading(report, folder, Path(source)))
        if found.mask.shape != shape:
            raise InputError(
                f"{source} holds photographs of {in_pixels(found.mask.shape)} but the normals have {in_pixels(shape)}; "
                "give those that were measured."
            )
        if lit := report.get("found_lights"):
            found = lit_by(found, lit)
        _ = found.images[0]
        return found, None
    except (InputError, TypeError) as error:
        if given is not None:
            raise InputError(f"--capture: {error}") from None
        if not Path(source).exists():
            return None, f"The photographs are no longer in {source}; name them with --capture."
        return None, f"The photographs can't be read as they were when they were measured: {error}"


def _reading(report: StoredReport, folder: Path, source: Path) -> dict[str, Any]:
    """How the photographs are read, wherever they, and the files of the result in `folder`, lie by now."""
    before = Path(report.get("source", ""))
    before, now = (p.parent if p.suffix.lower() == ".lp" else p for p in (before, source))
    reading = {key: value for key, value in report.get("reading", {}).items() if key != "memory"}
    for key, value in reading.items():
        if isinstance(value, str) and os.path.isabs(value) and not os.path.exists(value):
            moved = [folder / Path(value).name]
            if Path(value).is_relative_to(before):
                moved.insert(0, now / Path(value).relative_to(before))
            reading[key] = str(next((p for p in moved if p.exists()), value))
    return reading


def lit_by(capture: Capture, lit: StoredLights) -> Capture:
    """The photographs under the lights that were found from them."""
    lights = np.array(lit["directions"], float).reshape(-1, 3)
    intensities = np.array(lit["intensities"], float) if "intensities" in lit else None
    for found in (lights, intensities):
        if found is not None and len(found) != capture.images.shape[0]:
            raise InputError(f"the report has {len(found)} lights for {capture.images.shape[0]} photographs; {AGAIN}.")
    return under(capture, lights, intensities)


def _add_photographs(about: dict[str, Any], capture: Capture | None, box: tuple[slice, slice]) -> PicturePlanes | None:
    if capture is None:
        return None
    L = capture.lights
    about["photographs"] = [
        {"index": j, "name": name, "light": None if L is None else [round(float(v), 5) for v in L[j]]}
        for j, name in enumerate(capture.image_names)
    ]
    picture = capture.images[frontal(L)]
    return PicturePlanes(capture, box, max(float(np.quantile(picture[capture.mask], 0.99)), 1e-6))
