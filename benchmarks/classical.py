"""Accuracy and seconds of every classical method on DiLiGenT objects, beside the published figures.

    python benchmarks/classical.py [--draws 100] [--device cpu] [--methods woodham,l1] [--runs 3] ROOT
    python benchmarks/classical.py --memory 300000

ROOT holds `<object>PNG` folders. Prints Markdown: mean angular error with all images (and, in brackets, the published
one), and the best of several runs on cat, on pictures in memory: seconds of the whole call; in brackets without the
conversion to grey levels, which all methods share, and seconds of processor time. With --draws, also the errors with
few random lights: mean and standard deviation over draws of fixed seeds, at every --draw-step-th row and column. With
--memory, needs no ROOT: the most memory that each method takes beyond the pictures, for that many pixels and 96 images.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

import photonormal as pn
from photonormal.geometry import angle_deg, fibonacci_hemisphere
from photonormal.methods import METHODS, configure
from photonormal.methods.engine import on_mask, run, samples
from photonormal.methods.engine.device import torch_device

PUBLISHED = {  # ball bear buddha cat cow goblet harvest pot1 pot2 reading
    "woodham": "4.10 8.39 14.92 8.41 25.60 18.50 30.62 8.89 14.65 19.80",
    "rpca": "2.06 6.50 10.91 6.73 25.89 15.70 30.01 7.18 13.12 15.39",
    "l1": "2.54 7.32 11.11 7.21 25.70 16.25 29.26 7.74 14.09 16.17",
    "sbl": "2.54 7.32 11.11 7.21 25.70 16.25 29.26 7.74 14.09 16.17",
    "monotonic": "13.58 19.44 18.37 12.34 7.62 17.80 19.30 10.37 9.84 17.17",
    "consensus": "3.55 11.48 13.05 8.40 14.95 14.89 21.79 10.85 16.37 16.82",
    "table": "2.71 5.96 12.54 6.53 21.48 13.93 30.50 7.23 11.03 14.17",
    "ward": "3.21 6.62 14.85 8.22 9.55 14.22 27.84 8.53 7.90 19.07",
    "bivariate": "3.34 7.11 10.47 6.74 13.05 9.71 25.95 6.64 8.77 14.19",
    "bipolynomial": "1.74 6.12 10.60 6.12 13.93 10.09 25.44 6.51 8.78 13.63",
}
OBJECTS = ["ball", "bear", "buddha", "cat", "cow", "goblet", "harvest", "pot1", "pot2", "reading"]


def in_memory(capture: pn.Capture, step: int = 1) -> pn.Capture:
    """The capture with decoded pictures, at every `step`-th row and column."""
    images = np.stack(capture.map_images(lambda j, image: np.asarray(image)[::step, ::step]))
    truth = capture.truth and pn.Normals(capture.truth.map[::step, ::step], capture.truth.mask[::step, ::step])
    return replace(capture, images=images, mask=capture.mask[::step, ::step], truth=truth, saturation=None)


def under(capture: pn.Capture, chosen: np.ndarray) -> pn.Capture:
    """The capture under some of its lights."""
    return replace(
        capture, images=np.asarray(capture.images)[chosen], lights=capture.known_lights()[chosen], image_names=()
    )


def error_deg(capture: pn.Capture, method: str, device: torch.device) -> float:
    """Mean angular error over the mask; a pixel without a normal counts 90 degrees."""
    found = on_mask(run(configure(method), capture, device), capture)
    assert capture.truth is not None
    angle = angle_deg(found.map[capture.mask], capture.truth.map[capture.mask])
    return float(np.where(found.mask[capture.mask], angle, 90).mean())


def best_seconds(run: Callable[[], object], runs: int, device: torch.device) -> tuple[float, float]:
    """The fastest of several runs: seconds on the clock, and of processor time."""
    seconds, busy = [], []
    for _ in range(runs):
        start, start_busy = time.perf_counter(), time.process_time()
        run()
        if device.type == "cuda":
            torch.cuda.synchronize()
        seconds.append(time.perf_counter() - start)
        busy.append(time.process_time() - start_busy)
    return min(seconds), min(busy)


def memory_mb(method: str, pixels: int, device: str) -> float:
    """The most memory that a method takes beyond 96 grey pictures, in a process of its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_memory_mb, (method, pixels, device))


def _memory_mb(method: str, pixels: int, device: str) -> float:
    random = np.random.default_rng(0)
    lights = fibonacci_hemisphere(384)[:96]
    N = fibonacci_hemisphere(pixels)[random.permutation(pixels)].astype(np.float32)
    images = np.empty((96, 1, pixels, 1), np.float32)
    for image, light in zip(images, lights.astype(np.float32), strict=True):
        image[0, :, 0] = 0.3 * np.maximum(N @ light, 0) + 0.01 * random.random(pixels, np.float32)
    capture = pn.Capture(images, np.ones((1, pixels), bool), lights)
    solver = configure(method)
    run(solver, in_memory(capture, max(1, pixels // 500)), torch.device(device))  # what loading the libraries takes
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    run(solver, capture, torch.device(device))
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024


def print_row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path, nargs="?")
    parser.add_argument("--methods", default=",".join(PUBLISHED) + ",trimmed,median,ransac")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--draws", type=int, default=0, help="draws of few lights")
    parser.add_argument("--lights", type=int, default=10, help="lights in each draw")
    parser.add_argument("--draw-step", type=int, default=4, help="rows and columns of the draws: every step-th")
    parser.add_argument("--memory", type=int, default=0, help="pixels for which to measure memory instead")
    parser.add_argument("--runs", type=int, default=3, help="timed runs on cat; 0: none")
    parser.add_argument("--step", type=int, default=1, help="rows and columns of the accuracy table: every step-th")
    options = parser.parse_args()
    device = torch_device(options.device)
    methods = [m for m in options.methods.split(",") if m in METHODS]
    if options.memory:
        print_row("method", f"MB beyond the pictures, 96 x {options.memory}")
        print_row("---", "---")
        for method in methods:
            print_row(method, f"{memory_mb(method, options.memory, options.device):.0f}")
        return
    if options.root is None:
        parser.error("ROOT is needed, a folder that holds <object>PNG folders")
    loaded = {name: pn.load(options.root / f"{name}PNG") for name in OBJECTS if (options.root / f"{name}PNG").is_dir()}

    captures = {name: in_memory(capture, options.step) for name, capture in loaded.items()}
    if not captures:
        parser.error(f"no <object>PNG folders in {options.root}")
    print_row("method", *captures, "mean", "seconds on cat (solve, processor)")
    print_row(*["---"] * (len(captures) + 3))
    for method in methods:
        errors = [error_deg(capture, method, device) for capture in captures.values()]
        seconds = "-"
        if "cat" in captures and options.runs:
            cat = captures["cat"]
            whole, busy = best_seconds(lambda m=method, c=cat: run(configure(m), c, device), options.runs, device)
            grey, _ = best_seconds(lambda c=cat: samples.grey_levels(c), options.runs, device)
            seconds = f"{whole:.2f} ({max(0.0, whole - grey):.2f}, {busy:.2f})"
        published = [float(x) for x in PUBLISHED.get(method, "").split()]
        published = [published[OBJECTS.index(name)] for name in captures] if published else []
        both = zip([*errors, np.mean(errors)], [*published, np.mean(published)] if published else [], strict=False)
        cells = [f"{ours:.2f} ({theirs:.2f})" for ours, theirs in both] or [
            f"{x:.2f}" for x in [*errors, np.mean(errors)]
        ]
        print_row(method, *cells, seconds)

    if options.draws:
        small = {name: in_memory(capture, options.draw_step) for name, capture in loaded.items()}
        print(f"\n{options.lights} random lights, {options.draws} draws:\n")
        print_row("method", *small, "mean")
        print_row(*["---"] * (len(small) + 2))
        for method in methods:
            table = []
            for capture in small.values():
                n = len(capture.known_lights())
                draws = (np.random.default_rng(seed).permutation(n)[: options.lights] for seed in range(options.draws))
                table.append([error_deg(under(capture, np.sort(chosen)), method, device) for chosen in draws])
            values = np.array(table)  # (objects, draws)
            cells = [f"{v.mean():.2f} ± {v.std():.2f}" for v in [*values, values.mean(0)]]
            print_row(method, *cells)


if __name__ == "__main__":
    main()
