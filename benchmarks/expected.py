"""How far a method can be trusted: expected and true errors, and the calibration behind the former.

    python benchmarks/expected.py [ROOT] [--methods woodham,normalnet] [--scenes 240] [--lights 32] [--near 2]
    python benchmarks/expected.py --fit [--scenes 1000] [--methods normalnet:fast=true]

Prints Markdown: pixels sorted by expected error and cut into ten equal parts, mean expected and true errors of each in
degrees, on rendered objects of materials that the calibration never saw (PHOTONORMAL_DATA) and on DiLiGenT's objects
in ROOT (`<object>PNG` folders). Methods that solve each pixel by itself are shown every second row and column.
`--near`: the lamps' distance in widths of the frame. `--fit` renders other objects of other materials, under 3 to 100
lights, most of them in set-ups that networks never learn from (UNLIKE), and writes
`src/photonormal/methods/expected.json`, where methods that are not named keep what they have. A
method may have options, as in `normalnet:fast=true`: a calibration holds for those alone. A network of one rig is
shown other scenes, under the lamps of its rig.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import torch
from classical import OBJECTS, in_memory, print_row, under

import photonormal as pn
from photonormal.geometry import angle_deg
from photonormal.methods import METHODS, configure, parse
from photonormal.methods.contract import Method, Solution, Streaming
from photonormal.methods.engine import on_mask, run
from photonormal.methods.engine.near import seen_as_distant
from photonormal.methods.evidence import evidence_of
from photonormal.methods.expected import FILE, FITTED, SHIFT, MadeFor, linear, terms, with_expected_error
from photonormal.synth import Stream
from photonormal.types import Camera, Lamps

# fitted on every fourth block of scenes, so that they see all of its kinds
NETWORKS = ("lambertian-prior", "normalnet", "psfcn", "psfcn-normalised", "gps-net", "dr-psn", "attention-psn")
STEP: dict[str, int] = dict.fromkeys(("rpca", *NETWORKS), 1) | dict.fromkeys(("ward", "consensus"), 3)
# of rows and columns; others: 2. These look at all pixels, or many of them, together
KEPT = 150  # pixels of a scene, about
SET_UP: dict[str, Any] = dict(  # what goes wrong in one, by much more than where networks learn
    **dict(light_error_deg=3.0, intensity_error=0.08, corrupted=0.3, ambient=0.04, noise=0.02, bounce=0.9),
    **dict(blurred=0.6, low_bits=0.4, dark=0.15, jpeg=0.2, gamma=0.15, clipped=0.15),
)
UNLIKE: tuple[dict[str, Any], ...] = (  # kinds of scenes, by turns
    {},
    dict(meshes="data", mesh_share=0.4, **SET_UP),
    dict(distance=14.0, **SET_UP),  # half widths of the scene: lamps that are taken for distant ones
)
FEWEST = 24  # images of a scene; calibrations see some of them, too
BLOCK = 4  # scenes with one number of images
CPU = torch.device("cpu")
IMAGES = (4, 6, 10, 18, 32, 56, 92)  # at which calibrations are fitted
NEARBY = 0.6  # standard deviation of ln images, of the scenes' weights around them
RIDGE = 1e-2
CURVE = (0.005, 0.02, 0.04, 0.07, *np.arange(0.12, 0.9, 0.08), 0.93, 0.96, 0.98, 0.995)  # shares of the pixels below
# which a curve is read off, one part each: its ends count as well as its middle

Directions = tuple[tuple[float, float, float], ...]
Found = dict[
    str, list[tuple[int, np.ndarray, np.ndarray]]
]  # by method with options: images, evidence (p, k), errors (p,)


def scenes(count: int, seed: int, **changes) -> Iterator[pn.Capture]:
    """Rendered objects."""
    stream = Stream("objects", 1, "cpu", seed, **changes)
    distance, size = stream.recipe_of(0).distance, stream.recipe_of(0).size
    for b in islice(stream, count):
        mask = b.mask[0, 0].numpy()
        truth = pn.Normals(b.normals[0].permute(1, 2, 0).numpy(), mask)
        capture = pn.Capture(b.images[0].permute(0, 2, 3, 1).numpy(), mask, b.lights[0].numpy(), truth=truth)
        if distance is not None:
            lamps = Lamps(distance * size / 2 * capture.known_lights())
            capture = replace(capture, lamps=lamps, camera=Camera(1.0))
        yield capture


def method_of(text: str) -> Method:
    """A method with its options."""
    name, options = parse(text)
    return configure(name, **options)


def step_of(text: str) -> int:
    """Of rows and columns that a method is shown."""
    return STEP.get(parse(text)[0], 2)


def thinned(whole: pn.Capture, step: int) -> pn.Capture:
    """Every so many rows and columns of a capture."""
    capture = in_memory(whole, step)
    return capture if capture.camera is None else replace(capture, camera=Camera(step * capture.camera.mm_per_px))


def fit(count: int, methods: Sequence[str]) -> None:
    """Render, measure, fit, write."""
    found: Found = {text: [] for text in methods}
    for rig, under_it in by_rig(methods).items():
        for i, whole in enumerate(unlike(count, 780, rig)):
            for text in under_it:
                if parse(text)[0] not in NETWORKS or i // BLOCK % 4 == 0:
                    measured(text, whole, found)
                    if not rig:
                        measured(text, under_some(whole, i), found)
    write(found, count)


def unlike(count: int, seed: int, rig: Directions) -> Iterator[pn.Capture]:
    """Scenes of the kinds of UNLIKE, a block of each by turns, their lamps taken for distant ones."""
    changes = dict(lights=(FEWEST, FITTED[1]), scenes=BLOCK, split="train", narrow=0.8, directions=rig)
    kinds = [scenes(count, seed + k, **changes, **kind) for k, kind in enumerate(UNLIKE)]
    for i in range(count):
        yield replace(next(kinds[i // BLOCK % len(kinds)]), lamps=None, camera=None)


def under_some(capture: pn.Capture, seed: int) -> pn.Capture:
    """The capture under 3 to FEWEST of its lights."""
    g = np.random.default_rng(seed)
    count = round(np.exp(g.uniform(*np.log((FITTED[0], FEWEST)))))
    return under(capture, np.sort(g.permutation(len(capture.known_lights()))[:count]))


def by_rig(methods: Sequence[str]) -> dict[Directions, list[str]]:
    """Methods by the lamps that their weights are for; (): any."""
    found: dict[Directions, list[str]] = {}
    for text in methods:
        method = method_of(text)
        rig = getattr(method.network().config, "lights", ()) if isinstance(method, Streaming) else ()
        found.setdefault(rig, []).append(text)
    return found


def solved(text: str, whole: pn.Capture) -> tuple[pn.Capture, pn.Normals, Solution] | None:
    """What a method is shown and finds; None with too few lights for it, or in the dark."""
    capture = thinned(whole, step_of(text))
    try:
        found = run(method_of(text), capture, CPU)
        return capture, on_mask(found, capture), found
    except pn.InputError:
        return None


def measured(text: str, whole: pn.Capture, found: Found) -> None:
    """Add a method's evidence and errors on some pixels of a capture."""
    if (both := solved(text, whole)) is None:
        return
    capture, normals, found_here = both
    assert capture.truth is not None
    told = None
    if found_here.told_deg is not None:
        told = np.full(normals.mask.shape, np.nan, np.float32)
        told[capture.mask] = found_here.told_deg.numpy()
    F = evidence_of(seen_as_distant(capture, normals), normals, CPU, told).double().numpy()
    some = slice(None, None, -(-len(F) // KEPT))
    found[text].append((len(capture.known_lights()), F[some], true_deg(normals, capture.truth)[some]))


def true_deg(normals: pn.Normals, truth: pn.Normals) -> np.ndarray:
    return angle_deg(normals.map[normals.mask], truth.map[normals.mask])


def write(found: Found, count: int) -> None:
    """Fit the methods that were measured and write FILE; the others keep what they have."""
    methods = json.loads(FILE.read_text())["methods"] | {
        text: {"made_for": asdict(MadeFor.of(method_of(text))), "scenes": count} | calibration(rows)
        for text, rows in found.items()
    }
    lines = [f"  {json.dumps(name)}: {json.dumps(one)}" for name, one in methods.items()]
    FILE.write_text('{"made by": "python benchmarks/expected.py --fit", "methods": {\n' + ",\n".join(lines) + "\n}}\n")


def calibration(rows: list[tuple[int, np.ndarray, np.ndarray]]) -> dict[str, list]:
    """Weights and a curve at each of IMAGES that enough scenes came near to; rounded to what they mean."""
    n = np.concatenate([np.full(len(e), images) for images, _, e in rows])
    scene = np.concatenate([np.full(len(e), 1 / len(e)) for *_, e in rows])  # each counts as much as another
    T, y = np.concatenate([terms(F, F) for _, F, _ in rows]), np.concatenate([e for *_, e in rows])
    fitted: dict[str, list] = {"images": [], "weights": [], "curve": []}
    for images in [images for images in IMAGES if images >= n.min()] or IMAGES[-1:]:
        near = scene * np.exp(-0.5 * (np.log(n / images) / NEARBY) ** 2)
        some = near > 1e-3 * scene
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
    """Mean x and ln mean y of parts of the pixels by x, neighbours pooled where y falls."""
    order = np.argsort(x)
    share = np.cumsum(w[order]) / w.sum()
    parts = [p for p in np.split(order, np.searchsorted(share, CURVE)) if len(p)]
    pooled: list[tuple[float, float, int]] = []  # mean y, weight, parts
    for part in parts:
        pooled.append((np.average(y[part], weights=w[part]), w[part].sum(), 1))
        while len(pooled) > 1 and pooled[-2][0] > pooled[-1][0]:
            (b, v, k), (a, u, j) = pooled.pop(), pooled.pop()
            pooled.append(((a * u + b * v) / (u + v), u + v, j + k))
    means = np.repeat([a for a, *_ in pooled], [k for *_, k in pooled])
    return np.array([np.average(x[p], weights=w[p]) for p in parts]), np.log(means)


def deciles(label: str, captures: Iterable[pn.Capture], methods: Sequence[str], shift: float) -> None:
    """Two rows for each method: expected and true errors of ten equal parts of the pixels; `shift` is the truth's."""
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {text: [] for text in methods}
    for whole in captures:
        for text in methods:
            if (both := solved(text, whole)) is None:
                continue
            capture, normals, found_here = both
            normals = with_expected_error(normals, found_here.told_deg, capture, method_of(text), CPU, shift)
            assert capture.truth is not None and normals.expected_error_deg is not None
            on = normals.mask & capture.truth.mask
            true = angle_deg(normals.map[on], capture.truth.map[on])
            found[text].append((normals.expected_error_deg[on], true))
    for text, pairs in found.items():
        told, true = (np.concatenate(values) for values in zip(*pairs, strict=True))
        parts = np.array_split(np.argsort(told), 10)
        e, t = (np.array([v[p].mean() for p in parts]) for v in (told, true))
        within = str(int((np.abs(e / t - 1) <= 0.25).sum()))
        print_row(text, f"{label}, expected", *[f"{v:.2f}" for v in e], f"{told.mean():.2f}", within)
        print_row("", f"{label}, true", *[f"{v:.2f}" for v in t], f"{true.mean():.2f}", "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, nargs="?")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--lights", type=int, default=32)
    parser.add_argument("--near", type=float)
    args = parser.parse_args()
    if args.fit:
        return fit(args.scenes or 1000, args.methods.split(","))
    print_row("method", "pixels", *[f"{10 * i} to {10 * i + 10} %" for i in range(10)], "all", "within 25 %")
    print_row(*["---"] * 14)
    methods = args.methods.split(",")
    distance = None if args.near is None else 2 * args.near
    lights = (args.lights, args.lights)
    count = 240 if args.scenes is None else args.scenes
    for rig, under_it in by_rig(methods).items() if count else ():
        rendered = scenes(count, 12345, lights=lights, scenes=1, distance=distance, directions=rig)
        deciles("rendered", rendered, under_it, 0.0)
    for name in OBJECTS if args.root else ():
        if (args.root / f"{name}PNG").is_dir():
            deciles(name, [pn.load(args.root / f"{name}PNG")], methods, SHIFT)


if __name__ == "__main__":
    main()
