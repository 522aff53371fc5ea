"""Depth from true normals against measured depth: DiLiGenT's bear, cat and reading, every method, both views.

    python benchmarks/integrate.py --data FOLDER

Mean absolute depth error (mm) over the mask that comes with the depth; each object is one connected part. Perspective:
after one scale factor, the one that minimises this error. Orthographic: after a scale and an offset by least squares,
since heights are in pixels and have no origin; what remains is mostly that the camera was not orthographic. The
principal point of K.txt moves with the crop. `bilateral (one-sided)` is without our last rounds. Seconds are processor
time of the whole call, the best of three. The second table is a smooth surface in an ellipse. The third is of rendered
solids whose depth jumps, with true normals: mean absolute error in pixels after the best offset, beside `BiNI's
equations`, a plain program of what its paper says. Without `--data` the first table is left out.

Parts that meet at jumps alone may lie anywhere, so that a scene's error says much of its view and little of the method.
`--views 5` turns each scene five times at random and prints how many of the views `bilateral` finds better than BiNI's
equations, and the geometric mean of the errors' ratio: after one offset of all, and after one of each part. No normal
tells how far parts that meet at jumps alone lie from each other; a part is what hangs together by steps of less than 3
pixels of the true depth.

`--against FOLDER` names the `src` of another version of this package (`git worktree add`). A fourth table sets its
`bilateral` beside this one's on all objects and scenes, both in the same run and each in a process of its own.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import cg
from scipy.special import expit
from solids import SCENES, scene

import photonormal as pn
from photonormal.capture.images import read_mask
from photonormal.integration import METHODS

ROWS = {method: (method, {}) for method in METHODS} | {"bilateral (one-sided)": ("bilateral", {"combined": 0})}
JUMPS = ("quadratic", "bilateral")  # methods of the rendered scenes
JUMP = 3.0  # pixels
VERSION = """
import sys, time
import numpy as np
import photonormal as pn
with np.load(sys.argv[1]) as file:
    normals, K = pn.Normals(file["map"], file["mask"]), file.get("K")
runs = []
for _ in range(3):
    start = time.process_time()
    depth = pn.integrate(normals, "bilateral", K=K).depth
    runs.append(time.process_time() - start)
np.savez(sys.argv[2], depth=depth, seconds=min(runs))
"""
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


def offset_error(depth: np.ndarray, z: np.ndarray) -> float:
    """Mean absolute error in pixels after the best offset, where both are known."""
    difference = (depth - z)[np.isfinite(depth) & np.isfinite(z)]
    return float(np.abs(difference - np.median(difference)).mean())


def parts_error(depth: np.ndarray, z: np.ndarray) -> float:
    """The same after the best offset of each part of `z`, whose pixels are neighbours by steps of less than JUMP."""
    known = np.isfinite(depth) & np.isfinite(z)
    number = np.cumsum(known).reshape(known.shape) - 1
    pairs = []
    for i, j in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        near = known[i] & known[j] & (np.abs(np.nan_to_num(z[i]) - np.nan_to_num(z[j])) < JUMP)
        pairs.append((number[i][near], number[j][near]))
    i, j = np.concatenate(pairs, axis=1)
    touching = sparse.csr_matrix((np.ones(len(i)), (i, j)), shape=(known.sum(),) * 2)
    part = connected_components(touching, directed=False)[1]
    off = (depth - z)[known]
    order = np.argsort(part, kind="stable")
    each = np.split(off[order], np.flatnonzero(np.diff(part[order])) + 1)
    return float(np.abs(np.concatenate([o - np.median(o) for o in each])).mean())


def bini(normals: pn.Normals) -> np.ndarray:
    """Depth by the published equations of bilateral normal integration (ECCV 2022), orthographic; NaN off the mask.

    k = 2, conjugate gradients with the diagonal to a residual of 1e-3, at most 150 rounds, until the energy changes by
    less than 1e-4.
    """
    mask, number = normals.mask, np.cumsum(normals.mask).reshape(normals.mask.shape) - 1
    n, p = normals.map[mask].astype(np.float64), int(mask.sum())
    sides = []
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):  # u+, u-, v+, v-
        shifted = np.pad(np.where(mask, number, -1), 1, constant_values=-1)
        other = shifted[1 + dy : 1 + dy + len(mask), 1 + dx : 1 + dx + mask.shape[1]][mask]
        i = np.nonzero(other >= 0)[0]
        step = (dx + dy) * n[i, 2]
        sides.append(sparse.csr_matrix((np.r_[step, -step], (np.r_[i, i], np.r_[other[i], i])), shape=(p, p)))
    A = sparse.vstack(sides).tocsr()
    b = np.concatenate([-n[:, 0], -n[:, 0], n[:, 1], n[:, 1]]) * (np.diff(A.indptr) > 0)
    w, z, energy = np.full(4 * p, 0.5), np.zeros(p), np.inf
    for _ in range(150):
        WA = sparse.diags_array(w) @ A
        N = (A.T @ WA).tocsr()
        z, _ = cg(N, WA.T @ b, x0=z, rtol=1e-3, maxiter=5000, M=sparse.diags_array(1 / np.maximum(N.diagonal(), 1e-5)))
        before, energy = energy, float((w * (A @ z - b) ** 2).sum())
        if abs(before - energy) < 1e-4 * before:
            break
        u_next, u_last, v_next, v_last = ((A @ z) ** 2).reshape(4, p)
        u, v = expit(2 * (u_last - u_next)), expit(2 * (v_last - v_next))
        w = np.concatenate([u, 1 - u, v, 1 - v])
    depth = np.full(mask.shape, np.nan)
    depth[mask] = z
    return depth


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
    parser.add_argument("--data", type=Path, help="folder that holds diligent/")
    parser.add_argument("--size", type=int, default=320, help="pixels along a side of the rendered scenes")
    parser.add_argument("--views", type=int, default=0, help="views of each rendered scene, turned at random")
    parser.add_argument("--against", type=Path, help="src of another version of this package")
    arguments = parser.parse_args()
    if arguments.data:
        real_objects(arguments.data)
    smooth_surface()
    rendered(arguments.size)
    if arguments.views:
        views(arguments.views, arguments.size)
    if arguments.against:
        versions(arguments.against, arguments.data, arguments.size)


def real_objects(data: Path) -> None:
    """Print the first table."""
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


def smooth_surface() -> None:
    """Print the second table."""
    normals, z = ellipse()
    print("\n| method | pixels | rms error, pixels | s |\n|---|---|---|---|")
    for row in ROWS:
        surface, seconds = timed(normals, row)
        print(f"| {row} | {normals.mask.sum()} | {(surface.depth - z)[normals.mask].std():.1g} | {seconds:.3f} |")


def rendered(size: int) -> None:
    """Print the third table."""
    rows = {name: lambda n, m=m, o=o: pn.integrate(n, m, **o).depth for name, (m, o) in ROWS.items() if m in JUMPS}
    rows["BiNI's equations"] = bini
    print("\n| scene | pixels |" + "".join(f" {row} | s |" for row in rows))
    print("|---|---|" + "---|---|" * len(rows))
    for name in SCENES:
        normals, z = scene(name, size)
        cells = []
        for method in rows.values():
            start = time.process_time()
            depth = method(normals)
            seconds = time.process_time() - start
            cells += [f"{offset_error(depth, z):.3f}", f"{seconds:.2f}"]
        print(f"| {name} | {normals.mask.sum()} | " + " | ".join(cells) + " |", flush=True)


def views(count: int, size: int) -> None:
    """Print the table of `--views`."""
    random = np.random.default_rng(11)
    head = "better | worse | ratio of errors | the best and the worst |"
    print(f"\n| scene | {head} parts apart: {head}\n|---|" + "---|" * 8)
    every: list[tuple[float, float]] = []
    for name in SCENES:
        for _ in range(count):
            normals, z = scene(name, size, random.uniform(-40, 40), random.uniform(-25, 25))
            ours, theirs = pn.integrate(normals, "bilateral").depth, bini(normals)
            every.append(
                (offset_error(ours, z) / offset_error(theirs, z), parts_error(ours, z) / parts_error(theirs, z))
            )
        print(f"| {name} | " + " | ".join(map(compared, zip(*every[-count:], strict=True))) + " |", flush=True)
    print("| all | " + " | ".join(map(compared, zip(*every, strict=True))) + " |")


def compared(ratios: Sequence[float]) -> str:
    """Cells of a row: views whose error is less and more, the geometric mean, the extremes."""
    r = np.array(ratios)
    return f"{(r < 1).sum()} | {(r > 1).sum()} | {np.exp(np.log(r).mean()):.3f} | {r.min():.3f}, {r.max():.3f}"


def versions(other: Path, data: Path | None, size: int) -> None:
    """Print the fourth table."""
    this = Path(pn.__file__).parents[1]
    print("\n| scene | pixels | before | s | now | s | times as fast |\n|---|---|---|---|---|---|---|")
    for name in [*(OBJECTS if data else ()), *SCENES]:
        if data and name in OBJECTS:
            normals, K, truth = real_object(data, name)
        else:
            (normals, truth), K = scene(name, size), None
        cells, seconds = [], []
        for src in (other, this):
            surface, s = bilateral_of(src, normals, K)
            error = offset_error(surface.depth, truth) if K is None else depth_error_mm(surface, truth)
            cells += [f"{error:.4g}{'' if K is None else ' mm'}", f"{s:.2f}"]
            seconds.append(s)
        ratio = seconds[0] / seconds[1]
        print(f"| {name} | {normals.mask.sum()} | " + " | ".join(cells) + f" | {ratio:.1f} |", flush=True)


def bilateral_of(src: Path, normals: pn.Normals, K: np.ndarray | None) -> tuple[pn.Surface, float]:
    """As `timed`, by the version of this package in `src`."""
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder, "normals.npz"), Path(folder, "surface.npz")
        np.savez(given, map=normals.map, mask=normals.mask, **({} if K is None else {"K": K}))
        subprocess.run(
            [sys.executable, "-c", VERSION, given, found], check=True, env=os.environ | {"PYTHONPATH": str(src)}
        )
        with np.load(found) as file:
            return pn.Surface(file["depth"], normals.mask, K), float(file["seconds"])


if __name__ == "__main__":
    main()
