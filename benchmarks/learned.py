"""How well a learned method does on DiLiGenT objects: its options, few images, faults of a set-up.

    python benchmarks/learned.py ROOT [--method normalnet] [--weights FILE] [--tables options,images,faults,levels]

ROOT holds `<object>PNG` folders. Prints Markdown; angles are means over the mask in degrees. `images`: draws of fixed
seeds at full resolution. `faults`: what each fault costs. `levels`: pictures of few grey levels. How far it can be
trusted: `benchmarks/expected.py`.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from classical import OBJECTS, in_memory, print_row, under

import photonormal as pn
from photonormal.files.decode import decode_all
from photonormal.geometry import angle_deg
from photonormal.methods import configure, method_class
from photonormal.methods.contract import Method
from photonormal.methods.engine import on_mask, run
from photonormal.methods.engine.device import torch_device
from photonormal.png import encode_png
from photonormal.synth.sensor import corrupt, misaligned

Captures = dict[str, pn.Capture]


def errors_deg(found: pn.Normals, truth: pn.Normals) -> np.ndarray:
    """Angles over the truth's mask; a pixel without a normal counts 90 degrees."""
    angle = angle_deg(found.map[truth.mask], truth.map[truth.mask])
    return np.where(found.mask[truth.mask], angle, 90)


def mean_deg(solver: Method, capture: pn.Capture, device: torch.device) -> float:
    assert capture.truth is not None
    return float(errors_deg(on_mask(run(solver, capture, device), capture), capture.truth).mean())


def options(method: str, given: dict, captures: Captures, device: torch.device) -> None:
    """Passes, rotations or turns, priors; seconds of all objects together."""
    print_row("options", *captures, "mean", "seconds")
    print_row(*["---"] * (len(captures) + 3))
    known = {field.name for field in fields(method_class(method))}
    tried: list[dict] = [{"passes": p} for p in (1, 2, 3)] if "passes" in known else [{}]
    tried += [{"rotations": 4}] if "rotations" in known else []
    tried += [{"turns": t} for t in (1, 4, 10)] if "turns" in known else []
    tried += [{"prior": name} for name in ("woodham", "l1", "rpca")] if "prior" in known else []
    for more in tried:
        start = time.perf_counter()
        errors = [mean_deg(configure(method, **given, **more), c, device) for c in captures.values()]
        seconds = time.perf_counter() - start
        name = ", ".join(f"{k} {v}" for k, v in more.items()) or "default"
        print_row(name, *[f"{e:.2f}" for e in [*errors, np.mean(errors)]], f"{seconds:.1f}")


def few_images(solver: Method, captures: Captures, draws: int, device: torch.device) -> None:
    """All images, then random draws of some."""
    print_row("images", "draws", *captures, "mean")
    print_row(*["---"] * (len(captures) + 3))
    for k, count in ((0, 1), (32, max(1, draws // 10)), (10, draws), (4, draws)):
        table = []
        for capture in captures.values():
            n = len(capture.known_lights())
            chosen = (np.sort(np.random.default_rng(seed).permutation(n)[: k or n]) for seed in range(count))
            table.append([mean_deg(solver, under(capture, some), device) for some in chosen])
        values = np.array(table)  # (objects, draws)
        cells = [f"{v.mean():.2f} ± {v.std():.2f}" if count > 1 else f"{v[0]:.2f}" for v in [*values, values.mean(0)]]
        print_row(str(k or "all"), str(count), *cells)


def corrupted(capture: pn.Capture, share: float = 0.2) -> pn.Capture:
    """In a share of the images a half or a patch is dimmed or brightened, or the image is shifted."""
    I = torch.from_numpy(np.asarray(capture.images)).permute(0, 3, 1, 2)[None]
    worse = corrupt(I.expand(-1, -1, 3, -1, -1), np.array([share]), np.random.default_rng(0))
    return replace(capture, images=worse[0].permute(0, 2, 3, 1).numpy())


def misled(capture: pn.Capture, sigma_deg: float = 2.0) -> pn.Capture:
    """Light directions with an error of about `sigma_deg` degrees."""
    sigma = np.array([sigma_deg / np.sqrt(2)])  # about each of two axes
    return replace(capture, lights=misaligned(capture.known_lights()[None], np.random.default_rng(0), sigma)[0])


def coarse(capture: pn.Capture) -> pn.Capture:
    """Eight bits, with the brightest thousandth of the samples saturated."""
    I = np.asarray(capture.images)
    white = float(np.quantile(I[:, capture.mask], 0.999))
    return replace(capture, images=(np.round(np.clip(I / white, 0, 1) * 255) / 255 * white).astype(np.float32))


FAULTS = {
    "none": lambda c: c,
    "20 % corrupted images": corrupted,
    "lights off by 2 degrees": misled,
    "8 bits": coarse,
}


def faults(solver: Method, captures: Captures, device: torch.device) -> None:
    """What each fault of a set-up costs."""
    print_row("fault", *captures, "mean")
    print_row(*["---"] * (len(captures) + 2))
    for name, spoil in FAULTS.items():
        try:
            errors = [mean_deg(solver, spoil(c), device) for c in captures.values()]
        except pn.InputError as error:
            print_row(name, str(error))
            continue
        print_row(name, *[f"{e:.2f}" for e in [*errors, np.mean(errors)]])


STORED = {"cut off": 0, "rounded": 1, "middle of a step": 0}  # half levels that are added before the rest is dropped


def with_levels(folder: Path, out: Path, levels: int, stored: str) -> pn.Capture:
    """A DiLiGenT object whose files have but `levels` grey levels up to the brightest sample of the object.

    They are of 8 bits, or of 16 where each level is stored as the middle of its step.
    """
    out.mkdir(parents=True)
    names = (folder / "filenames.txt").read_text().split()
    mask = decode_all(folder / "mask.png")[..., 0] > 0
    brightest = max(int(decode_all(folder / name)[mask].max()) for name in names)
    for file in folder.iterdir():
        if file.name not in names:
            shutil.copy(file, out)
    for name in names:
        halves = decode_all(folder / name).astype(np.int64) * 2 * levels // brightest + STORED[stored]
        counts = np.minimum(halves // 2, 255)
        middle = stored == "middle of a step"
        (out / name).write_bytes(encode_png((2 * counts + 1).astype(np.uint16) if middle else counts.astype(np.uint8)))
    return pn.load(out)


def few_levels(solver: Method, root: dict[str, Path], device: torch.device) -> None:
    """All levels of the files, then few."""
    print_row("grey levels", *root, "mean")
    print_row(*["---"] * (len(root) + 2))
    rows = {"all": lambda folder, out: pn.load(folder)}
    rows |= {f"{n}, {stored}": partial(with_levels, levels=n, stored=stored) for n in (48, 32) for stored in STORED}
    for name, spoilt in rows.items():
        errors = []
        for folder in root.values():
            with tempfile.TemporaryDirectory() as scratch:
                errors.append(mean_deg(solver, spoilt(folder, Path(scratch) / folder.name), device))
        print_row(name, *[f"{e:.2f}" for e in [*errors, np.mean(errors)]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", type=Path)
    parser.add_argument("--method", default="normalnet")
    parser.add_argument("--weights", default="")
    parser.add_argument("--tables", default="options,images,faults,levels")
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--step", type=int, default=1, help="of rows and columns, where a network sees single pixels")
    parser.add_argument("--device", default="cpu")
    given = parser.parse_args()
    device = torch_device(given.device)
    found = {name: given.root / f"{name}PNG" for name in OBJECTS if (given.root / f"{name}PNG").is_dir()}
    if not found:
        parser.error(f"no <object>PNG folders in {given.root}")
    captures = {name: in_memory(pn.load(folder), given.step) for name, folder in found.items()}
    weights = {"weights": given.weights} if given.weights else {}
    solver = configure(given.method, **weights)
    tables = {
        "options": lambda: options(given.method, weights, captures, device),
        "images": lambda: few_images(solver, captures, given.draws, device),
        "faults": lambda: faults(solver, captures, device),
        "levels": lambda: few_levels(solver, found, device),
    }
    for name in given.tables.split(","):
        print(f"\n{name}\n")
        tables[name]()


if __name__ == "__main__":
    main()
