"""The paper's ablations at one small budget: all `paper` recipes and both PS-FCN learn from the same rendered scenes.

    python benchmarks/ablations.py OUT [--recipes paper paper-plain] [--steps 400] [--seed 0]

The same for all: a quarter of the width, eight windows of 16 x 16 pixels a step, a rate of 1e-3 that falls as a cosine
after a warm-up (the paper's 2e-3, halved seven times, is for 24 windows and a hundred times as many steps). Loss, prior
and number of images are each recipe's own. Scenes of 64 lights are rendered once, `steps` / 4 batches, each used about
four times; a recipe of 32 images takes the first 32 lights. Then all networks are examined on the same scenes with 32
images, and on the four DiLiGenT objects of PHOTONORMAL_DATA with all of theirs.

OUT/results.jsonl holds a line for each recipe and seed. The same command finishes an interrupted run; the table is of
all that OUT holds for that many steps. Angles are means in degrees; below 15: share of the pixels, %; minutes: of
processor time, to train and to measure the objects.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import torch
from classical import print_row
from safetensors import safe_open

from photonormal.solve.engine.device import torch_device
from photonormal.solve.learned.network import parameters
from photonormal.solve.learned.weights import load
from photonormal.synth import Stream
from photonormal.synth.stream import Batch
from photonormal.train import checkpoint, train
from photonormal.train.recipes import RECIPES, Recipe
from photonormal.train.validate import EXAMS, OBJECTS, examined, on_rendered

BUDGET = {"batch": 8, "reuse": 4, "lr": 1e-3, "schedule": "cosine", "warmup": 50}
WIDTH, WINDOW, LIGHTS = 16, 16, 64
EXAM = replace(RECIPES["paper"], batch=8, images=(32, 32))
NAMES = [name for name in RECIPES if name.startswith(("paper", "psfcn"))]
VALIDATION = {  # the paper's Tables 1 and 5: mean angle on its validation set
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
}
REAL = {  # its Table 2, 96 images: mean of ball, bear, cat and reading
    "paper": 6.46,
    "paper-10-images": 6.77,
    "paper-64-images": 6.37,
    "psfcn": 7.46,
}
COLUMNS = ["recipe", "seed", "parameters", "minutes", "prior", "hemisphere", "difference", "the paper's", "below 15"]
COLUMNS += ["10 images", "clean", *OBJECTS, "real", "difference", "the paper's"]

Scenes = dict[str, list[Batch]]


def at_budget(name: str, seed: int) -> Recipe:
    """A recipe with what is the same for all."""
    r = RECIPES[name]
    return replace(r, config=r.config | {"width": WIDTH}, seed=seed, **BUDGET)


def rendered(file: Path, steps: int, seed: int, device: torch.device) -> Scenes:
    """The batches of the training and of every exam, images as 16-bit floats; from the file where there is one."""
    if not file.exists():
        stream = Stream("train", BUDGET["batch"], device, seed, lights=(LIGHTS, LIGHTS), crop=WINDOW)
        training, exams = islice(stream, math.ceil(steps / BUDGET["reuse"])), examined(Stream, device, EXAM)
        made = {"train": training, **exams}
        torch.save({k: [vars(b) | {"images": b.images.half()} for b in some] for k, some in made.items()}, file)
    held = torch.load(file, map_location="cpu")
    return {kind: [Batch(**b) for b in some] for kind, some in held.items()}


def served(scenes: Scenes) -> Callable[..., Iterator[Batch]]:
    """Scenes in place of a `photonormal.synth.Stream`, with the first of their lights."""

    def stream(
        name: str, batch: int, device: torch.device, seed: int, start_step: int, lights: tuple[int, int], **changes
    ) -> Iterator[Batch]:
        kind = next(k for k, fields in EXAMS.items() if fields == changes) if name == "validation" else "train"
        n = lights[1]
        for b in scenes[kind][start_step:]:
            tensors = b.images[:, :n].float(), b.lights[:, :n], b.normals, b.mask
            yield Batch(*(x.to(device) for x in tensors))

    return stream


def learned(name: str, out: Path, steps: int, seed: int, scenes: Scenes, device: torch.device) -> dict:
    """Train one recipe, or go on with it, and examine it."""
    recipe, stream = at_budget(name, seed), served(scenes)
    resume = (out / checkpoint.NAME).exists()
    start = time.process_time()
    path = train(recipe, out, steps=steps, stream=stream, resume=resume, device=device.type, name=name)
    minutes = (time.process_time() - start) / 60
    net = load(path, recipe.network, device)
    with safe_open(path, "pt") as file:
        trained = json.loads(file.metadata()["trained"])
    with_32, with_10 = (replace(recipe, images=(n, n)) for n in (32, 10))
    exams = examined(stream, device, with_32)
    found = {kind: on_rendered(net, exam, with_32) for kind, exam in exams.items()}
    found |= {"10 images": on_rendered(net, exams["hemisphere"], with_10), "real": trained["errors"]["real"]}
    size = {"parameters": parameters(net), "minutes": minutes, "steps": trained["steps"]}
    return {"recipe": name, "seed": seed, **size, **found}


def compared(r: dict, base: dict | None, kind: str, mean: str, published: dict[str, float]) -> list[str]:
    """A mean angle, how far it is from the default's, and how far that is in the paper."""
    name, ours = r["recipe"], r[kind].get(mean)
    cells = ["" if ours is None else f"{ours:.2f}", "", ""]
    if name != "paper" and ours is not None and base is not None:
        cells[1] = f"{ours - base[kind][mean]:+.2f}"
    if name != "paper" and name in published:
        cells[2] = f"{published[name] - published['paper']:+.2f}"
    return cells


def table(results: list[dict]) -> None:
    """Markdown; differences are from `paper` of the same seed."""
    default = {r["seed"]: r for r in results if r["recipe"] == "paper"}
    print_row(*COLUMNS)
    print_row(*["---"] * len(COLUMNS))
    for r in sorted(results, key=lambda r: (NAMES.index(r["recipe"]), r["seed"])):
        base, hemisphere, real = default.get(r["seed"]), r["hemisphere"], r["real"]
        print_row(
            *[r["recipe"], str(r["seed"]), f"{r['parameters']:,}", f"{r['minutes']:.1f}"],
            f"{hemisphere['prior_deg']:.2f}" if "prior_deg" in hemisphere else "",
            *compared(r, base, "hemisphere", "mean_deg", VALIDATION),
            *[f"{hemisphere['below_15']:.1f}", f"{r['10 images']['mean_deg']:.2f}", f"{r['clean']['mean_deg']:.2f}"],
            *[f"{real[o]:.2f}" if o in real else "" for o in OBJECTS],
            *compared(r, base, "real", "mean", REAL),
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--recipes", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="auto")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    device, file = torch_device(given.device), given.out / "results.jsonl"
    lines = file.read_text().splitlines() if file.exists() else []
    results = [r for line in lines if (r := json.loads(line))["steps"] == given.steps]
    done = [r["recipe"] for r in results if r["seed"] == given.seed]
    if missing := [name for name in given.recipes if name not in done]:
        run = f"{given.steps}-{given.seed}"
        scenes = rendered(given.out / f"scenes-{run}.pt", given.steps, given.seed, device)
        for name in missing:
            results.append(learned(name, given.out / f"{name}-{run}", given.steps, given.seed, scenes, device))
            with file.open("a", encoding="utf-8") as opened:
                opened.write(json.dumps(results[-1]) + "\n")
    table(results)


if __name__ == "__main__":
    main()
