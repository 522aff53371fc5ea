"""Depth from true normals against measured depth: DiLiGenT's bear, cat and reading, every method, both views.

    python benchmarks/integrate.py --data FOLDER

Mean absolute depth error (mm) over the mask. Perspective: after one scale factor, the one that minimises this error.
Orthographic: after a scale and an offset by least squares, since heights are in pixels and have no origin; what remains
is mostly that the camera was not orthographic. Seconds are processor time of the whole call.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import photonormal as pn
from photonormal.capture.images import read_mask
from photonormal.integrate import METHODS

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds diligent/")
    data = parser.parse_args().data
    print("| method | view |" + "".join(f" {o} mm | s |" for o in OBJECTS))
    print("|---|---|" + "---|---|" * len(OBJECTS))
    scenes = {o: real_object(data, o) for o in OBJECTS}
    for method in METHODS:
        for view in ("perspective", "orthographic"):
            cells = []
            for normals, K, depth in scenes.values():
                start = time.process_time()
                surface = pn.integrate(normals, method, K=K if view == "perspective" else None)
                cells += [f"{depth_error_mm(surface, depth):.3f}", f"{time.process_time() - start:.2f}"]
            print(f"| {method} | {view} | " + " | ".join(cells) + " |", flush=True)
    print("| *BiNI, published* | perspective |" + "".join(f" {mm:.3f} | |" for mm in OBJECTS.values()))


if __name__ == "__main__":
    main()
