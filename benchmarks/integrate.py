"""Depth from true normals against measured depth: DiLiGenT's bear, cat and reading, every method, both views.

    python benchmarks/integrate.py --data FOLDER

Mean absolute depth error (mm) over the mask that comes with the depth; each object is one connected part.
Perspective: after one scale factor, the one that minimises this error. Orthographic: after a scale and an offset by
least squares, since heights are in pixels and have no origin; what remains is mostly that the camera was not
orthographic. The principal point of K.txt moves with the crop. `bilateral (paper)` is without our last solve. Seconds
are processor time of the whole call, the best of three. The second table is a smooth surface in an ellipse.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import photonormal as pn
from photonormal.capture.images import read_mask
from photonormal.integration import METHODS

ROWS = {method: (method, {}) for method in METHODS} | {"bilateral (paper)": ("bilateral", {"midpoint": False})}
OBJECTS = {"bear": 0.334, "cat": 0.074, "reading": 0.257}  # published by BiNI (ECCV 2022) for the bilateral method


def real_object(data: Path, name: str) -> tuple[pn.Normals, np.ndarray, np.ndarray]:
    """True normals, camera matrix and depth (mm, NaN where unknown) of a DiLiGenT object, cropped alike."""
    folder, depth_folder = data / "diligent" / "pmsData" / f"{name}PNG", data / "diligent" / "depth" / name
    y0, y1, x0, x1 = map(int, (folder / "crop.txt").read_text().split())
    truth = pn.load(folder).truth
    assert truth is not None
    with np.load(depth_folder / "depth_gt.npz") as file:
        depth = file["depth_gt"][y0:y1, x0:x1].astype(np.float64)
    mask = truth.mask & read_mask(depth_folder / "mask.png")[y0:y1, x0:x1]
    K = np.loadtxt(depth_folder / "K.txt")
    K[:2, 2] -= x0, y0
    return pn.Normals(truth.map * mask[..., None], mask), K, depth


def depth_error_mm(surface: pn.Surface, depth_mm: np.ndarray) -> float:
    """Mean absolute error in mm after the best scale (perspective), or scale and offset (orthographic)."""
    known = np.isfinite(surface.depth) & np.isfinite(depth_mm)
    ours, truth = surface.depth[known], depth_mm[known]
    if surface.K is None:
        scale, offset = np.polyfit(ours, truth, 1)
        return float(np.abs(scale * ours + offset - truth).mean())
    ratio = truth / ours
    order = np.argsort(ratio)
    weight = np.cumsum(ours[order])
    scale = ratio[order][np.searchsorted(weight, weight[-1] / 2)]  # weighted median: least absolute error
    return float(np.abs(scale * ours - truth).mean())


def ellipse(h: int = 512, w: int = 612) -> tuple[pn.Normals, np.ndarray]:
    """A smooth surface in an ellipse, with its heights in pixels."""
    y, x = np.mgrid[:h, :w] - np.array([(h - 1) / 2, (w - 1) / 2])[:, None, None]
    mask = (x / (0.49 * w)) ** 2 + (y / (0.455 * h)) ** 2 < 1
    z = 40 * np.cos(x / 150) * np.cos(y / 120) + 5 * np.sin(x / 17) * np.cos(y / 23)
    right = -40 / 150 * np.sin(x / 150) * np.cos(y / 120) + 5 / 17 * np.cos(x / 17) * np.cos(y / 23)
    down = -40 / 120 * np.cos(x / 150) * np.sin(y / 120) - 5 / 23 * np.sin(x / 17) * np.sin(y / 23)
    n = np.stack([-right, down, np.ones_like(z)], axis=-1)
    n = n / np.linalg.norm(n, axis=-1, keepdims=True)
    return pn.Normals(np.where(mask[..., None], n, 0).astype(np.float32), mask), z


def timed(normals: pn.Normals, row: str, K: np.ndarray | None = None) -> tuple[pn.Surface, float]:
    """The surface by the method of a row, and the processor seconds of the best of three calls."""
    method, options = ROWS[row]
    runs = []
    for _ in range(3):
        start = time.process_time()
        surface = pn.integrate(normals, method, K=K, **options)
        runs.append((surface, time.process_time() - start))
    return runs[0][0], min(seconds for _, seconds in runs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds diligent/")
    data = parser.parse_args().data
    print("| method | view |" + "".join(f" {o} mm | s |" for o in OBJECTS))
    print("|---|---|" + "---|---|" * len(OBJECTS))
    scenes = [real_object(data, o) for o in OBJECTS]
    for row in ROWS:
        for view in ("perspective", "orthographic"):
            cells = []
            for normals, K, depth in scenes:
                surface, seconds = timed(normals, row, K if view == "perspective" else None)
                cells += [f"{depth_error_mm(surface, depth):.3f}", f"{seconds:.2f}"]
            print(f"| {row} | {view} | " + " | ".join(cells) + " |", flush=True)
    print("| *BiNI, published* | perspective |" + "".join(f" {mm:.3f} | |" for mm in OBJECTS.values()))

    normals, z = ellipse()
    print("\n| method | pixels | rms error, pixels | s |\n|---|---|---|---|")
    for row in ROWS:
        surface, seconds = timed(normals, row)
        print(f"| {row} | {normals.mask.sum()} | {(surface.depth - z)[normals.mask].std():.1g} | {seconds:.3f} |")


if __name__ == "__main__":
    main()
