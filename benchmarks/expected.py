"""How far a method can be trusted: expected and true errors, and the calibration behind those of the classical ones.

    python benchmarks/expected.py [ROOT] [--methods woodham,normalnet] [--lights 32] [--near 2]
    python benchmarks/expected.py --fit [--scenes 232]

Prints Markdown: pixels sorted by expected error and cut into ten equal parts, mean expected and true errors of each in
degrees, on 64 rendered objects of materials that the calibration never saw (PHOTONORMAL_DATA) and on DiLiGenT's objects
in ROOT (`<object>PNG` folders). `--near`: the lamps' distance in widths of the frame. `--fit` renders other objects of
other materials, under 3 to 100 lights, and writes `src/photonormal/solve/expected.json`. A method may have options, as
in `normalnet:weights=mine.safetensors`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from classical import OBJECTS, in_memory, print_row

import photonormal as pn
from photonormal.geometry import angle_deg
from photonormal.solve import METHODS, configure, parse, run
from photonormal.solve.expected import FILE, FITTED, evidence_of, linear, terms, with_expected_error
from photonormal.synth import Stream
from photonormal.types import Camera, Lamps

CLASSICAL = [name for name, place in METHODS.items() if ".classical." in place]
SLOW = ("table", "ward", "consensus")  # fitted on every third block of scenes
STEP = {"rpca": 1, **dict.fromkeys(SLOW, 3)}  # of rows and columns; others: 4. These look at all pixels at once
KEPT = 16  # one in so many pixels, where every row and column is used
BLOCK = 4  # scenes with one number of images
CPU = torch.device("cpu")
IMAGES = (4, 8, 16, 32, 80)  # at which calibrations are fitted
NEARBY = 0.5  # standard deviation of ln images, of the scenes' weights around them
RIDGE = 3e-3
CURVE = 16  # parts of the pixels that a curve is read off

Found = dict[str, list[tuple[int, np.ndarray, np.ndarray]]]  # by method: images, evidence (p, k), errors (p,)


def scenes(count: int, seed: int, step: int = 1, **changes) -> Iterator[pn.Capture]:
    """Rendered objects, at every `step`-th row and column."""
    stream = Stream("objects", 1, "cpu", seed, **changes)
    distance, size = stream.recipe.distance, stream.recipe.size
    for b in islice(stream, count):
        mask = b.mask[0, 0].numpy()
        truth = pn.Normals(b.normals[0].permute(1, 2, 0).numpy(), mask)
        capture = pn.Capture(b.images[0].permute(0, 2, 3, 1).numpy(), mask, b.lights[0].numpy(), truth=truth)
        capture = in_memory(capture, step)
        if distance is not None:
            lamps = Lamps(distance * size / 2 * capture.known_lights())
            capture = replace(capture, lamps=lamps, camera=Camera(step))
        yield capture


def fit(count: int) -> None:
    """Render, measure, fit, write."""
    found: Found = {name: [] for name in CLASSICAL}
    for i, whole in enumerate(scenes(count, 780, lights=FITTED, scenes=BLOCK, split="train", narrow=0.8)):
        for name in CLASSICAL:
            if name not in SLOW or i // BLOCK % 3 == 0:
                measured(name, whole, found)
    write(found, count)


def measured(name: str, whole: pn.Capture, found: Found) -> None:
    """Add a method's evidence and errors on some pixels of a capture."""
    step = STEP.get(name, 4)
    try:
        capture = in_memory(whole, step)
        normals = run(configure(name), capture, CPU)
    except pn.InputError:
        return  # too few lights for the method, or no pixel
    assert capture.truth is not None
    some = slice(None, None, KEPT if step == 1 else 1)
    F = evidence_of(capture, normals, CPU).double().numpy()
    found[name].append((len(capture.known_lights()), F[some], true_deg(normals, capture.truth)[some]))


def true_deg(normals: pn.Normals, truth: pn.Normals) -> np.ndarray:
    return angle_deg(normals.map[normals.mask], truth.map[normals.mask])


def write(found: Found, count: int) -> None:
    """Fit all methods and write FILE."""
    methods = {name: calibration(rows) for name, rows in found.items()}
    command = f"python benchmarks/expected.py --fit --scenes {count}"
    lines = [f"  {json.dumps(name)}: {json.dumps(one)}" for name, one in methods.items()]
    FILE.write_text(f'{{"made by": {json.dumps(command)}, "methods": {{\n' + ",\n".join(lines) + "\n}}\n")


def calibration(rows: list[tuple[int, np.ndarray, np.ndarray]]) -> dict[str, list]:
    """Weights and a curve at each of IMAGES that enough scenes came near to; rounded to what they mean."""
    n = np.concatenate([np.full(len(e), images) for images, _, e in rows])
    T, y = np.concatenate([terms(F, F) for _, F, _ in rows]), np.concatenate([e for *_, e in rows])
    fitted: dict[str, list] = {"images": [], "weights": [], "curve": []}
    for images in IMAGES:
        near = np.exp(-0.5 * (np.log(n / images) / NEARBY) ** 2)
        if images < n.min():
            continue
        some = near > 1e-3
        weights = log_linear(T[some], y[some], near[some])
        x, means = rising(linear(T[some], weights), y[some], near[some])
        fitted["images"].append(images)
        fitted["weights"].append([float(f"{w:.4g}") for w in weights])
        fitted["curve"].append([[round(float(v), 3) for v in values] for values in (x, means)])
    return fitted


def log_linear(T: np.ndarray, y: np.ndarray, w: np.ndarray) -> np.ndarray:
    """argmax of the gamma likelihood of y with mean exp(c0 + T c): relative errors count, and means come out right."""
    middle, spread = T.mean(0), T.std(0)
    spread[spread < 1e-6] = np.inf  # what never changes tells nothing
    Z = np.concatenate([np.ones((len(T), 1)), (T - middle) / spread], axis=1)
    w = w / w.sum()
    b = np.zeros(Z.shape[1])
    b[0] = np.log((w * y).sum())
    shrink = RIDGE * (np.arange(len(b)) > 0)
    for _ in range(100):
        ratio = y / np.exp(np.clip(Z @ b, -8, 5))
        slope = Z.T @ (w * (ratio - 1)) - shrink * b
        curvature = (Z * (w * np.minimum(ratio, 20))[:, None]).T @ Z + np.diag(shrink + 1e-9)
        step = np.linalg.solve(curvature, slope)
        b += step * min(1.0, 1 / np.abs(step).max())
        if np.abs(step).max() < 1e-4:
            break
    c = b[1:] / spread
    return np.concatenate([[b[0] - c @ middle], c])


def rising(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean x and ln mean y of equal parts of the pixels by x, neighbours pooled where y falls."""
    order = np.argsort(x)
    share = np.cumsum(w[order]) / w.sum()
    parts = [p for p in np.split(order, np.searchsorted(share, np.arange(1, CURVE) / CURVE)) if len(p)]
    pooled: list[list[float]] = []  # mean y, parts
    for part in parts:
        pooled.append([np.average(y[part], weights=w[part]), 1])
        while len(pooled) > 1 and pooled[-2][0] > pooled[-1][0]:
            (b, k), (a, j) = pooled.pop(), pooled.pop()
            pooled.append([(a * j + b * k) / (j + k), j + k])
    means = np.repeat([v for v, _ in pooled], [int(k) for _, k in pooled])
    return np.array([np.average(x[p], weights=w[p]) for p in parts]), np.log(means)


def deciles(text: str, sets: dict[str, list[pn.Capture]]) -> None:
    """Two rows for each set: expected and true errors of ten equal parts of the pixels."""
    name, options = parse(text)
    for label, captures in sets.items():
        told, true = [], []
        for capture in captures:
            assert capture.truth is not None
            normals = with_expected_error(run(configure(name, **options), capture, CPU), capture, name, CPU)
            if normals.expected_error_deg is None:
                return print_row(text, "does not tell what error to expect", *[""] * 12)
            both = normals.mask & capture.truth.mask
            told.append(normals.expected_error_deg[both])
            true.append(angle_deg(normals.map[both], capture.truth.map[both]))
        e, t = np.concatenate(told), np.concatenate(true)
        parts = np.array_split(np.argsort(e), 10)
        ratios = np.array([e[p].mean() / t[p].mean() for p in parts])
        within = str(int((np.abs(ratios - 1) <= 0.2).sum()))
        print_row(name, f"{label}, expected", *[f"{e[p].mean():.2f}" for p in parts], f"{e.mean():.2f}", within)
        print_row("", f"{label}, true", *[f"{t[p].mean():.2f}" for p in parts], f"{t.mean():.2f}", "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, nargs="?")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--methods", default=",".join(CLASSICAL))
    parser.add_argument("--lights", type=int, default=32)
    parser.add_argument("--near", type=float)
    parser.add_argument("--step", type=int, default=1, help="take every STEP-th row and column")
    args = parser.parse_args()
    if args.fit:
        return fit(args.scenes or 232)
    distance = None if args.near is None else 2 * args.near
    how = dict(lights=(args.lights, args.lights), scenes=1, distance=distance)
    sets = {"rendered": list(scenes(args.scenes or 64, 12345, args.step, **how))}
    for name in OBJECTS if args.root else ():
        if (args.root / f"{name}PNG").is_dir():
            sets[name] = [in_memory(pn.load(args.root / f"{name}PNG"), args.step)]
    print_row("method", "pixels", *[f"{10 * i} to {10 * i + 10} %" for i in range(10)], "all", "within 20 %")
    print_row(*["---"] * 14)
    for name in args.methods.split(","):
        deciles(name, sets)


if __name__ == "__main__":
    main()
