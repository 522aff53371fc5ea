"""The main path, from photographs to results: load -> solve -> integrate -> export, with a report of what was done."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import photonormal
from photonormal.capture import files_read, load
from photonormal.check import check
from photonormal.disk import Batch
from photonormal.export.folder import report as write_report
from photonormal.export.folder import whole_folder
from photonormal.geometry import in_frame
from photonormal.integrate import integrate
from photonormal.options import Device, Precision, check_value
from photonormal.progress import progress
from photonormal.score import colours, error_picture, score
from photonormal.solve import DEFAULT, configure, run
from photonormal.types import Capture, Normals, cores


def measure(
    capture: str | Path,
    out: str | Path,
    method: str = DEFAULT,
    device: str = "auto",
    mesh: bool = True,
    overwrite: bool = False,
    integration: str = "quadratic",
    normals_frame: str = "opengl",
    camera: Path | None = None,
    options: dict[str, Any] | None = None,
    precision: Precision = "auto",
    **how: Any,
) -> dict[str, Any]:
    """Measure one capture and write its results into the folder `out`, whole or not at all.

    Parameters
    ----------
    capture : folder or `.lp` file, as for `photonormal.load`, which `how` is passed on to
    out : folder for normals.png, normals.npz, albedo.png, depth.npz, mesh.ply, preview.png and report.json
    method : a key of photonormal.solve.METHODS; `options` are its fields
    device : "auto", "cpu" or "cuda"
    mesh : integrate the normals and write depth and mesh
    overwrite : write into a folder that exists and is no result of ours
    integration : a key of photonormal.integrate.METHODS
    normals_frame : frame of normals.png, a key of photonormal.geometry.FRAMES; normals.npz keeps ours
    camera : text file with the camera matrix (3, 3) in pixels of the photographs, for a perspective surface
    precision : what networks compute in, "float32" or "bf16"; "auto": bf16 where the machine has instructions for it

    Returns
    -------
    The report, as written.

    Raises
    ------
    InputError
        If anything given can't be used; then nothing has been written.
    """
    check_value(device, Device, "device")
    check_value(precision, Precision, "precision")
    solver: Any = configure(method, **(options or {}))
    K = read_camera(camera)
    in_frame(np.zeros(3), normals_frame)  # before any work is done
    seconds: dict[str, float] = {}
    with _stage("read", seconds):
        photographs = load(capture, **how)
    with whole_folder(Path(out), overwrite, files_read(capture, photographs, camera, *how.values())) as folder:
        with _stage("read", seconds):
            samples = _read(photographs)
        with _stage("check", seconds), progress("checking"):
            warnings = [finding.message for finding in check(photographs)]
        with _stage("solve", seconds), progress(f"normals by {method}"):
            from photonormal.solve.engine.near import seen_as_distant
            from photonormal.solve.expected import with_expected_error
            from photonormal.solve.learned.processor import computing_in, number_format
            from photonormal.solve.engine.near import seen_as_distant
            from photonormal.solve.inputs.grey import torch_device

            where = torch_device(device)
            with computing_in(precision):
                normals = run(solver, photographs, where)
                computed_in = number_format(where)
            seen = seen_as_distant(photographs, normals)
            normals = with_expected_error(normals, seen, method, where)
        with _stage("albedo", seconds), progress("albedo"):
            from photonormal.solve.albedo import lambertian_albedo

            albedo = lambertian_albedo(seen, normals)
        surface = None
        if mesh:
            with _stage("integrate", seconds), progress(f"depth by {integration}"):
                if K is None and photographs.camera is not None:
                    K = photographs.camera.K
                surface = integrate(normals, integration, K=K)
        with _stage("export", seconds), progress("writing"):
            _export(folder, photographs, normals, albedo, surface, normals_frame)
        dark = int(photographs.mask.sum()) - int(normals.mask.sum())
        if dark:
            warnings.append(f"{dark} pixels of the mask have no normal: no light reached them.")
        report = {
            "photonormal": photonormal.__version__,
            "capture": photographs.name,
            "source": str(Path(capture).resolve()) if Path(capture).exists() else str(capture),
            "reading": {key: str(v.resolve()) if isinstance(v, Path) else v for key, v in how.items() if v},
            "method": method,
            "options": _plain(asdict(solver)),
            "integration": integration if mesh else None,
            "normals_png_frame": normals_frame,
            "device": str(where),
            "precision": computed_in if hasattr(solver, "weights_sha256") else None,
            "images": list(photographs.image_names),
            "lights": photographs.images.shape[0],
            "light": "distant" if photographs.lamps is None else "near",
            "pixels": {"mask": int(photographs.mask.sum()), "measured": int(normals.mask.sum()), "dark": dark},
            "samples": samples,
            "seconds": seconds,
            "peak_memory_mb": _peak_memory_mb(),
            "weights_sha256": getattr(solver, "weights_sha256", None),
            "warnings": warnings,
        }
        if normals.expected_error_deg is not None:
            report["expected_error_deg"] = round(float(np.nanmean(normals.expected_error_deg)), 3)
        if photographs.truth is not None:
            report["score"] = score(normals, photographs.truth).as_dict()
        return write_report(folder, report)


def read_camera(path: Path | None) -> np.ndarray | None:
    """The camera matrix in a text file of 3 rows; None for an orthographic view."""
    if path is None:
        return None
    from photonormal.capture.texts import read_table

    return read_table(path)


def _read(capture: Capture) -> dict[str, float]:
    """Decode every picture once, in threads; samples inside the mask that are saturated or zero, in per cent."""
    n, _, _, c = capture.images.shape
    with progress(f"reading {n} images", n) as advance:

        def count(j: int, image: np.ndarray) -> tuple[int, int]:
            samples = image[capture.mask]  # (p, c)
            # the division by the light's intensity rounds: a saturated sample may fall short by the last bits
            white = np.inf if capture.saturation is None else capture.saturation[j] * (1 - 1e-5)
            advance()
            return int((samples >= white).sum()), int((samples <= 0).sum())

        saturated, zero = np.sum(capture.map_images(count), axis=0)
    total = n * c * int(capture.mask.sum())
    return {
        "saturated_percent": round(100 * float(saturated) / total, 3),
        "zero_percent": round(100 * float(zero) / total, 3),
    }


def _export(folder: Batch, capture: Capture, normals: Normals, albedo: np.ndarray, surface: Any, frame: str) -> None:
    """Every file of a result but the report, written at the same time."""
    from photonormal.export import save
    from photonormal.export.normal_maps import encode_png
    from photonormal.export.pictures import preview

    white = float(np.quantile(albedo[normals.mask], 0.99)) or 1.0

    def pictures() -> None:
        folder.write("albedo.png", encode_png(np.rint(65535 * (albedo / white).clip(0, 1)).astype(np.uint16)))
        error = error_picture(normals, capture.truth) if capture.truth is not None else None
        brightest = int(np.argmax(capture.known_lights()[:, 2]))  # the light nearest to the camera shows most
        photograph = capture.images[brightest]
        photograph = photograph / max(float(np.quantile(photograph[capture.mask], 0.99)), 1e-6)
        folder.write("preview.png", encode_png(preview(photograph, normals, albedo / white, error)))
        if error is not None:
            folder.write("error.png", encode_png(error))
        if normals.expected_error_deg is not None:
            folder.write("expected-error.png", encode_png(colours(normals.expected_error_deg)))

    jobs = [
        pictures,
        lambda: save(normals, folder / "normals.png", frame=frame),
        lambda: save(normals, folder / "normals.npz"),
    ]
    if surface is not None:
        jobs.append(lambda: save(surface, folder / "depth.npz"))
        jobs.insert(0, lambda: save(surface, folder / "mesh.ply", normals, albedo / white))
    with ThreadPoolExecutor(cores()) as pool:
        for job in [pool.submit(job) for job in jobs]:
            job.result()


@contextmanager
def _stage(name: str, seconds: dict[str, float]) -> Iterator[None]:
    start = time.perf_counter()
    yield
    seconds[name] = round(seconds.get(name, 0.0) + time.perf_counter() - start, 4)


def _plain(value: Any) -> Any:
    """JSON's kinds of values only: paths become text."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    return value if isinstance(value, (int, float, str, bool, type(None))) else str(value)


def _peak_memory_mb() -> float | None:
    """Largest resident size of this process so far; None where the system does not say."""
    try:
        import resource
    except ImportError:
        return None
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit, 1)
