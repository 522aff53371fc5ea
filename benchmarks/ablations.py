"""The paper's ablations at one small budget: its Tables 1 and 5, its data amounts and PS-FCN, from the same scenes.

    python benchmarks/ablations.py OUT [--recipes paper paper-plain] [--minutes 30] [--seeds 1 2] [--windows 6000]
    python benchmarks/ablations.py OUT --width 32     the same by networks of half the paper's width, not a quarter
    python benchmarks/ablations.py OUT --table        the table of all that OUT holds for those minutes and width
    python benchmarks/ablations.py OUT --curves       convergence.png and .pdf in OUT/figures, from the journals

The same for all: the width and the minutes, of one processor, validation as it goes counted in. All else is each
recipe's own. Windows under 64 lights are rendered once into OUT/scenes-NAME (shards, 0.4 MB a window, read
where they lie); each time one comes up, other images of it are shown. For the data amounts `windows` of the stand-ins
for Blobby and Sculpture are rendered, in the proportion of the sets; a set alone has its own share of them only.

Then all networks are examined on the same rendered windows, with 32 images and with 10, and on the four DiLiGenT
objects of PHOTONORMAL_DATA with all images and with 10 (the mean of DRAWS draws). OUT/results.jsonl holds a line for
each recipe and seed. The same command finishes an interrupted run. Angles are means in degrees; below 15: share of
the pixels, %.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from classical import in_memory, print_row, under
from safetensors import safe_open

from photonormal.bench.figures import figure
from photonormal.capture import load as load_capture
from photonormal.methods.engine import on_mask
from photonormal.methods.engine.device import torch_device
from photonormal.methods.engine.stream import measured
from photonormal.methods.learned.network import Network, parameters
from photonormal.methods.learned.weights import load_network
from photonormal.scoring import score
from photonormal.synth import Stream, render
from photonormal.synth.recipes import MIXTURES, recipe
from photonormal.train import checkpoint, train
from photonormal.train.recipes import RECIPES, Recipe
from photonormal.train.validate import OBJECTS, examined, on_rendered, real_folder

LIGHTS, DRAWS = 64, 5
VALIDATE = 200  # steps between two points of a curve
EXAM = replace(RECIPES["paper"], images=(32, 32))
NAMES = [name for name in RECIPES if name.startswith(("paper", "psfcn")) and not name.endswith("cpu")]
VALIDATION = {  # the paper's Tables 1 and 5 and its data amounts: mean angle on its validation set
    "paper": 12.30,
    "paper-no-prior": 12.98,
    "paper-prior-rpca": 12.27,
    "paper-plain": 12.45,
    "paper-concat-3": 12.32,
    "paper-concat-none": 12.54,
    "paper-3-blocks": 12.37,
    "paper-5-blocks": 12.32,
    "paper-7-blocks": 12.29,
    "paper-single-branch": 12.52,
    "paper-both": 12.30,
    "paper-blobby": 12.64,
    "paper-sculpture": 12.39,
    "paper-both-no-prior": 12.98,
    "paper-blobby-no-prior": 13.79,
    "paper-sculpture-no-prior": 13.23,
}
REAL = {  # its Table 2, 96 images: mean of ball, bear, cat and reading
    "paper": 6.46,
    "paper-10-images": 6.77,
    "paper-64-images": 6.37,
    "psfcn": 7.46,
}
COLUMNS = ["recipe", "seed", "parameters", "samples", "prior", "hemisphere", "difference", "the paper's", "below 15"]
COLUMNS += ["10 images", "clean", *OBJECTS, "real", "difference", "the paper's", "real, 10 images"]

Result = dict[str, Any]


def at_budget(name: str, seed: int, width: int) -> Recipe:
    """A recipe at that width."""
    r = RECIPES[name]
    return replace(r, config=r.config | {"width": width}, seed=seed, validate=VALIDATE)


def scenes(out: Path, stream: str, windows: int, device: torch.device) -> list[Path]:
    """The sets that a recipe of this stream learns from, rendered where they are not there yet."""
    amounts = dict(MIXTURES["blobs-and-sculptures"])
    mine = amounts if stream == "blobs-and-sculptures" else {stream: amounts.get(stream, sum(amounts.values()))}
    sets = []
    for part, share in mine.items():
        count = round(windows * share / sum(amounts.values()))
        sets.append(out / f"scenes-{part}-{count}")
        if not sets[-1].exists():
            print(f"rendering {count} windows of {part}", flush=True)
            render(recipe(part, lights=(LIGHTS, LIGHTS)), count, sets[-1], layout="shards", device=device)
    return sets


def learned(name: str, seed: int, given: argparse.Namespace, device: torch.device) -> Network:
    """Train one recipe, or go on with it."""
    r, out = at_budget(name, seed, given.width), folder(given, name, seed)
    path = train(
        r,
        out,
        minutes=given.minutes,
        resume=(out / checkpoint.NAME).exists(),
        device=device.type,
        name=name,
        data=scenes(given.out, r.stream, given.windows, device),
        clock=time.process_time,
    )
    return load_network(path, r.network, device)


def budget(given: argparse.Namespace) -> dict[str, Any]:
    """What is the same for all recipes."""
    return {"minutes": given.minutes, "windows": given.windows, "width": given.width}


def folder(given: argparse.Namespace, name: str, seed: int) -> Path:
    """Where a recipe's training lies."""
    return given.out / f"{name}-{given.minutes:g}-{given.width}-{seed}"


def exam(name: str, seed: int, net: Network, exams: dict, given: argparse.Namespace, device: torch.device) -> Result:
    """One line of the results."""
    with safe_open(folder(given, name, seed) / f"{name}.safetensors", "pt") as file:
        trained = json.loads(file.metadata()["trained"])
    with_32, with_10 = (replace(at_budget(name, seed, given.width), images=(n, n)) for n in (32, 10))
    found = {kind: on_rendered(net, batches, with_32) for kind, batches in exams.items()}
    found |= {"10 images": on_rendered(net, exams["hemisphere"], with_10)}
    found |= {"real": trained["errors"]["real"], "real, 10 images": few_images(net, device)}
    size = {"parameters": parameters(net), "steps": trained["steps"], "batch": trained["recipe"]["batch"]}
    return {"recipe": name, "seed": seed, **budget(given), **size, **found}


def few_images(net: Network, device: torch.device, count: int = 10) -> dict[str, float]:
    """Mean error over draws of some images of each real object, and their mean; empty where there are none."""
    root, found = real_folder(), {}
    for name in OBJECTS:
        if root is None or not (root / f"{name}PNG").is_dir():
            continue
        capture = in_memory(load_capture(root / f"{name}PNG"))
        assert capture.truth is not None
        errors = []
        for seed in range(DRAWS):
            chosen = np.sort(np.random.default_rng(seed).permutation(len(capture.known_lights()))[:count])
            seen = under(capture, chosen)
            errors.append(score(on_mask(measured(net, seen, device), seen), capture.truth).mean_deg)
        found[name] = float(np.mean(errors))
    return found | ({"mean": float(np.mean(list(found.values())))} if found else {})


def base(name: str) -> str:
    """The recipe that another is compared with: of the data amounts, both sets, with or without prior."""
    if not any(part in name for part in ("blobby", "sculpture", "both")):
        return "paper"
    return "paper-both-no-prior" if name.endswith("no-prior") else "paper-both"


def compared(r: Result, other: Result | None, kind: str, mean: str, published: dict[str, float]) -> list[str]:
    """A mean angle, how far it is from the other's, and how far that is in the paper."""
    name, ours = r["recipe"], r[kind].get(mean)
    cells = ["" if ours is None else f"{ours:.2f}", "", ""]
    if name != base(name) and ours is not None and other is not None:
        cells[1] = f"{ours - other[kind][mean]:+.2f}"
    if name != base(name) and name in published:
        cells[2] = f"{published[name] - published[base(name)]:+.2f}"
    return cells


def table(results: list[Result]) -> None:
    """Markdown; differences are from the base of the same seed. Below it, how far seeds are apart."""
    by_key = {(r["recipe"], r["seed"]): r for r in results}
    print_row(*COLUMNS)
    print_row(*["---"] * len(COLUMNS))
    for r in sorted(results, key=lambda r: (NAMES.index(r["recipe"]), r["seed"])):
        other = by_key.get((base(r["recipe"]), r["seed"]))
        hemisphere, real = r["hemisphere"], r["real"]
        print_row(
            *[r["recipe"], str(r["seed"]), f"{r['parameters']:,}", f"{r['steps'] * r['batch']:,}"],
            f"{hemisphere['prior_deg']:.2f}" if "prior_deg" in hemisphere else "",
            *compared(r, other, "hemisphere", "mean_deg", VALIDATION),
            *[f"{hemisphere['below_15']:.1f}", f"{r['10 images']['mean_deg']:.2f}", f"{r['clean']['mean_deg']:.2f}"],
            *[f"{real[o]:.2f}" if o in real else "" for o in OBJECTS],
            *compared(r, other, "real", "mean", REAL),
            f"{r['real, 10 images']['mean']:.2f}" if r["real, 10 images"] else "",
        )
    for kind, mean in (("hemisphere", "mean_deg"), ("real", "mean")):
        seeds = {n: [r[kind][mean] for r in results if r["recipe"] == n and mean in r[kind]] for n in NAMES}
        apart = {n: max(v) - min(v) for n, v in seeds.items() if len(v) > 1}
        if apart:
            print(f"\nSeeds of one recipe apart, {kind}: " + ", ".join(f"{n} {d:.2f}" for n, d in apart.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--recipes", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--windows", type=int, default=6000)
    parser.add_argument("--width", type=int, default=16, help="channels of each network's first layer; the paper's 64")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--table", action="store_true", help="train nothing")
    parser.add_argument("--curves", action="store_true", help="train nothing; draw the curves of --recipes and --seeds")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    device, file = torch_device(given.device), given.out / "results.jsonl"
    if given.curves:
        places = {f"{n} {s}": folder(given, n, s) for n in given.recipes for s in given.seeds}
        drawn = [f"{label}={place}" for label, place in places.items() if (place / "journal.jsonl").exists()]
        print(*figure("convergence", drawn, given.out / "figures"), sep="\n")
        return
    lines = file.read_text().splitlines() if file.exists() else []
    results = [r for line in lines if budget(given).items() <= (r := json.loads(line)).items()]
    done = {(r["recipe"], r["seed"]) for r in results}
    missing = [(n, s) for s in given.seeds for n in given.recipes if (n, s) not in done and not given.table]
    exams = examined(Stream, device, EXAM) if missing else {}
    for name, seed in missing:
        net = learned(name, seed, given, device)
        results.append(exam(name, seed, net, exams, given, device))
        with file.open("a", encoding="utf-8") as opened:
            opened.write(json.dumps(results[-1]) + "\n")
    table(results)


if __name__ == "__main__":
    main()
