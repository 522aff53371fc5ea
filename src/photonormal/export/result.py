"""Everything that a measurement gives, as the files of one folder."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from photonormal.disk import Batch
from photonormal.export import encoded
from photonormal.export.folder import report
from photonormal.export.labels import with_scale
from photonormal.export.mesh import display
from photonormal.export.pictures import preview
from photonormal.png import SRGB, encode_png
from photonormal.score import colours, error_picture
from photonormal.types import Normals, Result, Surface, cores


def write_result(
    result: Result,
    folder: Batch,
    frame: str = "opengl",
    read: dict[str, Any] | None = None,
    linear_albedo: bool = False,
) -> dict[str, Any]:
    """Write a result into a folder, all files at the same time; returns the report, as written.

    normals.png and normals.npz, albedo.png, depth.npz and mesh.ply (where depth was found), preview.png,
    expected-error.png, error.png (where the truth is known) and report.json. `frame` is that of normals.png, a key of
    photonormal.geometry.FRAMES; normals.npz keeps ours. `read`: how the capture was read, as
    `photonormal.capture.told` says it. `linear_albedo` leaves the sRGB curve out of albedo.png.
    """
    start = time.perf_counter()
    normals, surface = result.normals, result.surface

    def write(name: str, what: Normals | Surface, **how: Any) -> Callable[[], None]:
        return lambda: folder.write(name, encoded(what, name, **how))

    jobs = [
        lambda: pictures(result, folder, linear_albedo),
        write("normals.png", normals, frame=frame),
        write("normals.npz", normals),
    ]
    if surface is not None:
        jobs.append(write("depth.npz", surface))
        jobs.insert(0, write("mesh.ply", surface, normals=normals, albedo=shown_albedo(result)))
    with ThreadPoolExecutor(cores()) as pool:
        for job in [pool.submit(job) for job in jobs]:
            job.result()
    seconds = {**result.report["seconds"], "export": round(time.perf_counter() - start, 4)}
    return report(folder, result.report | (read or {}) | {"normals_png_frame": frame, "seconds": seconds})


def shown_albedo(result: Result) -> np.ndarray | None:
    """The albedo (h, w, 3) over what is brightest on the object; None where it was not found."""
    if result.albedo is None:
        return None
    return result.albedo / (float(np.quantile(result.albedo[result.normals.mask], 0.99)) or 1.0)


def pictures(result: Result, folder: Batch, linear_albedo: bool = False) -> None:
    """albedo.png, sRGB-encoded unless it is to be linear, preview.png, maps of true and expected errors where known."""
    capture, normals, albedo = result.capture, result.normals, shown_albedo(result)
    error = error_picture(normals, capture.truth) if capture.truth is not None else None
    if albedo is not None:
        if linear_albedo:
            shown = encode_png(np.rint(65535 * albedo.clip(0, 1)).astype(np.uint16))
        else:
            shown = encode_png(display(albedo, full=65535), SRGB)
        folder.write("albedo.png", shown)
        folder.write("preview.png", encode_png(preview(photograph(result), normals, albedo, error)))
    if error is not None:
        folder.write("error.png", encode_png(with_scale(error)))
    if normals.expected_error_deg is not None:
        folder.write("expected-error.png", encode_png(with_scale(colours(normals.expected_error_deg))))


def photograph(result: Result) -> np.ndarray:
    """The photograph (h, w, c) under the light nearest to the camera, which shows most; linear, at most about 1."""
    capture = result.capture
    lights = capture.lights if result.lights is None else result.lights
    image = capture.images[0 if lights is None else int(np.argmax(lights[:, 2]))]
    return image / max(float(np.quantile(image[capture.mask], 0.99)), 1e-6)
