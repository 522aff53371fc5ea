"""How good a network is, by its prior's measure: on rendered scenes of a fixed seed and on real objects."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from math import ceil
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from photonormal.capture import load
from photonormal.methods.engine import on_mask
from photonormal.methods.engine.stream import measured
from photonormal.methods.learned.lightsnet import LightsNet
from photonormal.methods.learned.network import Model, Network
from photonormal.methods.learned.processor import inner_precision
from photonormal.methods.uncalibrated.guess import guess
from photonormal.scoring import score
from photonormal.scoring.lights import intensity_error, score_lights
from photonormal.shading import angle_deg
from photonormal.synth.recipes import RECIPES as SCENES
from photonormal.train.observe import Observed, observe, teller_of_lights
from photonormal.train.recipes import Recipe

log = logging.getLogger(__name__)

SEED = 2**31 - 1  # of the rendered validation scenes: never that of a training
BATCHES = 8  # of every exam, at most
EACH = 0.5  # minutes of learning for which an exam has one of them
HOLLOW = SCENES["hollow-metal"]
EXAMS = {  # on materials that training never sees
    "clean": {},  # all images exact
    "hemisphere": {"narrow": 0.0, "noise": 0.03, "saturated": 0.015},  # as the paper validates
    "dark": {"dark": 1.0},  # few grey levels
    "hollow-metal": {k: getattr(HOLLOW, k) for k in ("shapes", "materials", "metal", "varying", "bounce")},
}
OBJECTS = ("ball", "bear", "cat", "reading")


def examined(
    stream: Callable[..., Iterable], device: torch.device, recipe: Recipe, minutes: float | None = None
) -> dict[str, list]:
    """The batches of every exam: fixed scenes, windows as training has, as many images as it has at most.

    Where a training has few `minutes`, the first of these batches.
    """
    start, count = time.monotonic(), BATCHES if minutes is None else min(BATCHES, ceil(minutes / EACH))
    n = recipe.images[1]
    window = {k: v for k, v in recipe.rendered.items() if k in ("size", "crop", "crops", "zoom", "directions")}
    exam = partial(stream, "validation", recipe.batch, device, SEED, 0, lights=(n, n), **window)
    exams = {kind: list(islice(exam(**EXAMS[kind]), count)) for kind in recipe.exams}
    told = "exams (%s) of %d windows each, rendered in %.0f s"
    log.info(told, ", ".join(exams), count * recipe.batch, time.monotonic() - start)
    return exams


def errors_deg(N: Tensor, truth: Tensor, mask: Tensor) -> Tensor:
    """Angles between normals (b, 3, h, w) at all mask pixels, in degrees (p,)."""
    a, b = (x.movedim(1, -1)[mask[:, 0]].double() for x in (N, truth))
    return angle_deg(a, b)


def on_rendered(net: Model, batches: Iterable, recipe: Recipe) -> dict[str, float]:
    """How wrong a network is on an exam, by what it learns."""
    return normals_on(net, batches, recipe) if isinstance(net, Network) else lights_on(net, batches, recipe)


def shown(net: Model, batches: Iterable, recipe: Recipe) -> Iterator[Observed]:
    """What a network is shown of an exam; it does not train meanwhile."""
    net.eval()
    for i, batch in enumerate(batches):
        yield observe(batch, recipe, net.scaling, i, vary=False)
    net.train()


@torch.no_grad()
def lights_on(net: Model, batches: Iterable, recipe: Recipe) -> dict[str, float]:
    """Mean and median angle of the lights' directions, degrees, and the intensities' error (%)."""
    angles, wrong = [], []
    for seen in shown(net, batches, recipe):
        with inner_precision(seen.images.device):
            found = net(seen.images, seen.mask)
        angles.append(angle_deg(found.directions.double(), seen.lights.double()).flatten())
        estimated, drawn = (e.cpu().double().numpy() for e in (found.log_intensities.exp(), seen.intensities))
        wrong += [intensity_error(*pair) for pair in zip(estimated, drawn, strict=True)]
    e = torch.cat(angles)
    return {"mean_deg": float(e.mean()), "median_deg": float(e.median()), "intensity": 100 * float(np.mean(wrong))}


@torch.no_grad()
def normals_on(net: Network, batches: Iterable, recipe: Recipe) -> dict[str, float]:
    """Mean angular error of the network and of its prior, and the network's shares below 15 and 30 degrees (%)."""
    ours, priors = [], []
    for seen in shown(net, batches, recipe):
        with inner_precision(seen.images.device):
            found = net(seen.images, seen.lights, seen.prior, recipe.passes)[-len(seen.prior) :]
        ours.append(errors_deg(found[:, :3], seen.normals, seen.mask))
        priors.append(errors_deg(seen.prior, seen.normals, seen.mask))
    e = torch.cat(ours)
    found = {"mean_deg": float(e.mean()), "below_15": 100 * float((e < 15).double().mean())}
    found["below_30"] = 100 * float((e < 30).double().mean())
    return found | ({"prior_deg": float(torch.cat(priors).mean())} if recipe.priors else {})


def real_folder() -> Path | None:
    """DiLiGenT's objects under PHOTONORMAL_DATA; None where they are not."""
    folder = Path(os.environ.get("PHOTONORMAL_DATA", "")) / "diligent" / "pmsData"
    return folder if "PHOTONORMAL_DATA" in os.environ and folder.is_dir() else None


def on_real(net: Model, device: torch.device, recipe: Recipe) -> dict[str, float]:
    """Mean angular error on each real object, of normals or lights, and their mean; empty where there are none."""
    folder = real_folder()
    objects = {o: folder / f"{o}PNG" for o in OBJECTS if folder and (folder / f"{o}PNG").is_dir()}
    found = {}
    for name, path in objects.items():
        known, raw = load(path), load(path, lights="unknown")
        if isinstance(net, LightsNet):
            found[name] = score_lights(guess(net, raw, device).lights.numpy(), known.known_lights()).mean_deg
        elif isinstance(net, Network) and known.truth is not None:
            capture = (
                guess(teller_of_lights(recipe.lights, device), raw, device).shown_by(raw) if recipe.lights else known
            )
            normals = on_mask(measured(net, capture, device, passes=recipe.passes), capture)
            found[name] = score(normals, known.truth).mean_deg
    net.train()
    return found | ({"mean": float(np.mean(list(found.values())))} if found else {})
