"""Everything that a measurement gives, as the files of one folder."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from photonormal.disk import Content, FileBatch
from photonormal.export import encoded
from photonormal.export.folder import report
from photonormal.export.labels import with_scale
from photonormal.export.lights import lp, table
from photonormal.export.materials import write_materials
from photonormal.export.mesh import FACES, display, step_for
from photonormal.export.pictures import MARGIN, PREVIEW_HEIGHT, preview, thumbnail
from photonormal.lighting import frontal
from photonormal.masked import box_of, means
from photonormal.png import SRGB, by_rows, encode_png
from photonormal.resources import cores, in_threads
from photonormal.scoring import colours, error_picture
from photonormal.types import Normals, Result, Surface

LARGE = 2**22  # pixels of a frame above which one file is written after the other, to bound the memory
ENOUGH = 2**20  # pixels that show what is brightest
ROWS = 256  # of a picture made at a time


def write_result(
    result: Result,
    folder: FileBatch,
    frame: str = "opengl",
    read: dict[str, Any] | None = None,
    linear_albedo: bool = False,
    most_faces: int = FACES,
) -> dict[str, Any]:
    """Write a result into a folder, small files at the same time; returns the report, as written.

    normals.png and normals.npz, albedo.png, depth.npz and mesh.ply (where depth was found), preview.png,
    expected-error.png, error.png (where the truth is known), lights.lp and light_intensities.txt (where they were
    found), the maps of materials (where they were asked for) and report.json. `frame` is that of normals.png, a key of
    photonormal.geometry.FRAMES; normals.npz keeps ours. `read`: how the capture was read, as
    `photonormal.capture.reading_told` says it. `linear_albedo` leaves the sRGB curve out of albedo.png.
    The mesh has about `most_faces` triangles at most, and is in millimetres where the capture shows a pixel's width.
    """
    start = time.perf_counter()
    normals, surface, white = result.normals, result.surface, brightest(result)
    unit = None if result.capture.camera is None else result.capture.camera.mm_per_px
    facts: dict[str, Any] = {"normals_png_frame": frame}

    def write(name: str, what: Normals | Surface, **how: Any) -> Callable[[], None]:
        return lambda: folder.write(name, encoded(what, name, **how))

    jobs = [
        lambda: pictures(result, folder, white, linear_albedo),
        write("normals.png", normals, frame=frame),
        write("normals.npz", normals),
    ]
    if result.materials is not None:
        known = result.materials
        jobs.append(lambda: write_materials(known, normals.mask, white, folder))
    if surface is not None:
        mesh: dict[str, Any] = {"mm_per_px": unit, "most_faces": most_faces, "white": white}
        jobs += [
            write("mesh.ply", surface, normals=normals, albedo=result.albedo, **mesh),
            write("depth.npz", surface),
        ]
        facts["mesh"] = {"mm": unit is not None, "every": step_for(surface.mask, most_faces)}
    if result.lights is not None:
        folder.write("lights.lp", lp(result.capture.image_names, result.lights))
    if result.intensities is not None:
        folder.write("light_intensities.txt", table(result.intensities[:, None]))
    in_threads(lambda job: job(), jobs, cores() if normals.mask.size < LARGE else 1)
    facts["seconds"] = {**result.report["seconds"], "export": round(time.perf_counter() - start, 4)}
    return report(folder, result.report | (read or {}) | facts)


def brightest(result: Result) -> float:
    """The albedo that is shown white: what is brightest on the object, highlights aside."""
    if result.albedo is None:
        return 1.0
    step = max(1, int(np.sqrt(np.count_nonzero(result.normals.mask) / ENOUGH)))
    values = result.albedo[::step, ::step][result.normals.mask[::step, ::step]]
    return float(np.quantile(values, 0.99)) or 1.0 if len(values) else 1.0


def pictures(result: Result, folder: FileBatch, white: float, linear_albedo: bool = False) -> None:
    """albedo.png, sRGB-encoded unless it is to be linear, preview.png, thumbnail.png, maps of errors."""
    capture, normals, albedo = result.capture, result.normals, result.albedo
    error = error_picture(normals, capture.truth) if capture.truth is not None else None
    box = box_of(normals.mask, MARGIN)
    folder.write("thumbnail.png", encode_png(thumbnail(normals, box)))
    if albedo is not None:
        folder.write("albedo.png", albedo_png(albedo, white, linear_albedo))
        shown = preview(photograph(result, box), normals, albedo, white, error, box)
        folder.write("preview.png", encode_png(shown))
    if error is not None:
        folder.write("error.png", by_rows(*with_scale(lambda some: error[some], *error.shape[:2]), np.uint8))
    if (expected := normals.expected_error_deg) is not None:
        shown = with_scale(lambda some: colours(expected[some]), *expected.shape)
        folder.write("expected-error.png", by_rows(*shown, np.uint8))


def albedo_png(albedo: np.ndarray, white: float, linear: bool) -> Content:
    """16-bit, `white` and what is above it white."""

    def rows(some: slice) -> np.ndarray:
        part = albedo[some] / white
        return np.rint(65535 * part.clip(0, 1)) if linear else display(part, full=65535)

    return by_rows(rows, albedo.shape[:2], np.uint16, None if linear else SRGB)


def photograph(result: Result, box: tuple[slice, slice]) -> np.ndarray:
    """A part of the photograph (h, w, c) under the light nearest to the camera; linear.

    Large ones as means over squares of pixels, so that few rows are held at a time.
    """
    capture, (rows, columns) = result.capture, box
    lights = capture.lights if result.lights is None else result.lights
    j = frontal(lights)
    step = max(1, (rows.stop - rows.start) // (2 * PREVIEW_HEIGHT))
    if step == 1:
        return capture.window(j, rows, columns)
    tops = range(rows.start, rows.stop, step * ROWS)
    spans = [slice(top, min(top + step * ROWS, rows.stop)) for top in tops]
    return np.concatenate([means(capture.window(j, span, columns), step) for span in spans])
