"""Depth from true normals against measured depth: DiLiGenT's bear, cat and reading, every method, both views.

    python benchmarks/integrate.py --data FOLDER

Mean absolute depth error (mm) over the mask that comes with the depth; each object is one connected part.
Perspective: after one scale factor, the one that minimises this error. Orthographic: after a scale and an offset by
least squares, since heights are in pixels and have no origin; what remains is mostly that the camera was not
orthographic. The principal point of K.txt moves with the crop. `bilateral (paper)` is without our last rounds. Seconds
are processor time of the whole call, the best of three. The second table is a smooth surface in an ellipse. The third
is of rendered solids whose depth jumps, with true normals: mean absolute error in pixels after the best offset, beside
`BiNI's equations`, a plain program of what its paper says. Without `--data` the first table is left out.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy import sparse
from scipy.ndimage import label
from scipy.sparse.linalg import cg
from scipy.special import expit

import photonormal as pn
from photonormal.capture.images import read_mask
from photonormal.integration import METHODS
from photonormal.synth.trace import REACH, View, visible_surface

ROWS = {method: (method, {}) for method in METHODS} | {"bilateral (paper)": ("bilateral", {"combined": 0})}
JUMPS = ("quadratic", "bilateral")  # methods of the rendered scenes
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


def ball(p: torch.Tensor, centre: tuple, axes: tuple | float) -> torch.Tensor:
    """About the distance to an ellipsoid; `p` (1, 3, n)."""
    axes = torch.as_tensor(axes, dtype=torch.float32).expand(3)[:, None]
    return (((p - torch.tensor(centre, dtype=torch.float32)[:, None]) / axes).norm(dim=1) - 1) * axes.min()


def limb(p: torch.Tensor, start: tuple, end: tuple, r: float) -> torch.Tensor:
    """Distance to a rod with round ends."""
    a, b = (torch.tensor(v, dtype=torch.float32)[:, None] for v in (start, end))
    t = (((p - a) * (b - a)).sum(1, keepdim=True) / ((b - a) ** 2).sum()).clamp(0, 1)
    return (p - a - t * (b - a)).norm(dim=1) - r


def joined(parts: list[torch.Tensor], width: float) -> torch.Tensor:
    """Smooth union."""
    return -width * torch.logsumexp(torch.stack([-d / width for d in parts]), 0)


def animal(p: torch.Tensor) -> torch.Tensor:
    """A smooth body whose legs, head and ears stand before one another."""
    p = turned(p, 35, 12)
    legs = [limb(p, (x, -0.2, z), (1.1 * x, -0.78, z), 0.1) for x in (-0.42, 0.42) for z in (-0.2, 0.2)]
    head = [ball(p, (0.72, 0.3, 0.0), (0.26, 0.2, 0.18)), limb(p, (0.45, 0.05, 0.0), (0.66, 0.28, 0.0), 0.14)]
    ears = [limb(p, (0.66, 0.42, s * 0.1), (0.62, 0.55, s * 0.24), 0.035) for s in (-1, 1)]
    tail = limb(p, (-0.62, 0.1, 0.0), (-0.82, -0.3, 0.06), 0.035)
    return joined([ball(p, (0.0, 0.0, 0.0), (0.68, 0.3, 0.31)), *legs, *head, *ears, tail], 0.03)


def lathe(p: torch.Tensor, outer: list, wall: float, floor: float, tilt_deg: float) -> torch.Tensor:
    """A vessel turned about its axis: radii at heights, hollow from `floor` up, its mouth towards the camera."""
    x, y, z = turned(p, 0, tilt_deg).unbind(1)
    r = (x * x + z * z + 1e-12).sqrt()
    at, radii = (torch.tensor(v) for v in zip(*outer, strict=True))
    k = torch.searchsorted(at, y.detach().contiguous()).clamp(1, len(at) - 1)
    t = ((y - at[k - 1]) / (at[k] - at[k - 1])).clamp(0, 1)
    t = t * t * (3 - 2 * t)
    profile = radii[k - 1] + t * (radii[k] - radii[k - 1])
    solid = torch.maximum(0.6 * (r - profile), torch.maximum(y - at[-1], at[0] - y))
    inside = joined([0.6 * (r - profile + wall), floor - y], -0.02)
    return torch.maximum(solid, -inside)


def goblet(p: torch.Tensor) -> torch.Tensor:
    """A cup on a thin stem on a foot, looked into a little."""
    outer = [(-0.95, 0.5), (-0.85, 0.42), (-0.7, 0.09), (-0.2, 0.08), (0.1, 0.42), (0.5, 0.5), (0.95, 0.45)]
    return lathe(p, outer, 0.05, 0.02, 25)


def bowl(p: torch.Tensor) -> torch.Tensor:
    """A deep bowl, looked into."""
    return lathe(p, [(-0.6, 0.3), (-0.4, 0.55), (0.1, 0.85), (0.6, 0.95)], 0.08, -0.5, 48)


def well(p: torch.Tensor) -> torch.Tensor:
    """A pot as deep as it is wide, of which only the mouth and the inside are seen."""
    return lathe(p, [(-0.9, 0.5), (-0.3, 0.75), (0.3, 0.7), (0.9, 0.9)], 0.1, -0.8, 75)


def group(p: torch.Tensor) -> torch.Tensor:
    """Fruit and stalks in a heap, far behind one another."""
    g = np.random.default_rng(4)
    balls = [ball(p, tuple(g.uniform(-0.7, 0.7, 3) * (1, 1, 1.8)), tuple(g.uniform(0.18, 0.38, 3))) for _ in range(16)]
    stalks = [limb(p, tuple(g.uniform(-0.8, 0.8, 3)), tuple(g.uniform(-0.8, 0.8, 3)), 0.04) for _ in range(5)]
    return joined([*balls, *stalks, ball(p, (0.0, 0.0, -1.4), (0.9, 0.9, 0.3))], 0.01)


def grid(p: torch.Tensor) -> torch.Tensor:
    """Thin bent rods before a rolling ground that they reach at both ends."""
    x, y, z = p.unbind(1)
    ground = 0.8 * (z + 0.5 - 0.12 * torch.sin(4 * x) * torch.cos(3 * y))
    frame = torch.maximum(torch.maximum(x.abs(), y.abs()) - 0.95, ground)
    rods = []
    for k in range(5):
        u = -0.7 + 0.35 * k
        height = -0.55 + 0.7 * torch.sqrt((1 - (y / 0.9) ** 2).clamp(min=1e-4))
        rods.append(0.6 * (((x - u - 0.05 * torch.sin(5 * y)) ** 2 + (z - height) ** 2 + 1e-12).sqrt() - 0.025))
    return joined([frame, *rods], 0.008)


def turned(p: torch.Tensor, turn_deg: float, tilt_deg: float) -> torch.Tensor:
    """Points in the frame of a solid that is turned about the upright axis, then tilted towards the camera."""
    a, b = np.radians([turn_deg, tilt_deg])
    upright = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return torch.tensor((tilt @ upright).T, dtype=torch.float32) @ p


SCENES = {"animal": animal, "goblet": goblet, "bowl": bowl, "well": well, "group": group, "grid": grid}


@dataclass(frozen=True)
class Rendered:
    """What the renderer asks of a solid."""

    distance: Callable[[torch.Tensor], torch.Tensor]

    def field(self) -> Callable[[torch.Tensor], torch.Tensor]:
        return self.distance


def scene(name: str, size: int) -> tuple[pn.Normals, np.ndarray]:
    """The largest connected part of a rendered solid: exact normals, and heights in pixels (NaN elsewhere)."""
    view = View(torch.zeros(1, 2), torch.full((1,), 1.1), size)
    geometry = visible_surface(Rendered(SCENES[name]), view, torch.full((1, size * size), REACH))
    parts, _ = label(geometry.mask[0].numpy())
    mask = parts == np.bincount(parts[parts > 0]).argmax()
    n = geometry.normals[0].permute(1, 2, 0).numpy() * mask[..., None]
    return pn.Normals(n, mask), np.where(mask, geometry.height[0].double().numpy(), np.nan)


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
    arguments = parser.parse_args()
    if arguments.data:
        real_objects(arguments.data)
    smooth_surface()
    rendered(arguments.size)


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


if __name__ == "__main__":
    main()
