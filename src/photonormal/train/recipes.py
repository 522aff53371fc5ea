"""Recipes: everything that decides what a training gives, as frozen dataclasses. Ablations are one line each."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from math import cos, pi
from typing import Any

import numpy as np

from photonormal.types import InputError, by_name

ONE_RIG = ("dpsn",)  # networks that are learned for the lights of one rig
FALL = 0.25  # share of a flat training in which its rate falls


@dataclass(frozen=True)
class Recipe:
    """One training.

    Parameters
    ----------
    network, config : a name in methods.learned.weights.NETWORKS and the fields of its config that are not the default
    stream, rendering : recipe of `photonormal.synth` that renders the scenes, and the fields that are changed in it
    reuse, ring : how often a rendered batch is used, and how many batches wait for it; where rendering is slower than
        learning, each use with other images and another turn
    images : fewest and most images of a sample; one number per batch, log-uniform between them
    batch, accumulate : samples in a batch, over all processes together, and batches whose gradients make a step; each
        batch has its own number of images and its own prior
    steps : length of the training, where no `minutes` shorten it
    lr, schedule, warmup : peak rate; "halving" (`pieces` of equal length, each at half the rate of the one before),
        "cosine" or "flat" (the peak, but a straight fall over the last quarter), both down to 1 %; steps of linear
        rise before. A flat training can be made longer, before its fall, and is what a longer one would have been
    muon : peak rate of the weight matrices, which Muon then moves (`train.optimiser`); 0: Adam moves all
    clip : largest norm of the gradient; 0: any
    ema : share of the past that the running mean of the weights keeps at each step; 0: none. Where there is one, it is
        what validation measures and the weights file holds
    moved : how much of the way from the weights it began with (`--start-from`) to those it learned is what validation
        measures and the weights file holds; less than 1 keeps more of what the former knew
    priors : names of classical methods and their shares of the batches; "truth": the truth tilted by up to 30 degrees
    passes : how often the network looks at a batch, its own normals being the prior from the second time on; all
        passes are in the loss
    once : first steps, in which it looks but once, for half the work
    loss : "cosine" (1 - cos, the paper's) or "chord" (|n - n'|: about the angle itself, so that a few hopeless pixels
        do not outweigh all others)
    learn : the part of the network that learns, by the first letters of its parameters' names; "": all
    gain : factors between which the exposure of a sample is drawn
    intensities : factors between which the intensity of each light is drawn, for a network that learns lights
    lights : name of the package's weights of a network that finds lights: under those it learns, directions and
        intensities; "": under the true ones
    turns : quarter turns and mirror images of every batch; where `pixels` are drawn, any turn, each pixel its own
    pixels : drawn of each sample by chance, for a network that sees each by itself; 0: all, as pictures
    dark : share of the samples that are made black by chance, as by shadows that nobody rendered
    rig : unit directions of the lights that a network is learned for; (): any
    seed : of the weights, the stream and all of the above
    validate, exams : steps between validations, and the rendered ones of them (`train.validate.EXAMS`)
    """

    network: str = "lambertian-prior"
    config: dict[str, Any] = field(default_factory=dict)
    stream: str = "train"
    rendering: dict[str, Any] = field(default_factory=dict)
    reuse: int = 1
    ring: int = 64
    images: tuple[int, int] = (32, 32)
    batch: int = 24
    accumulate: int = 1
    steps: int = 140_600
    lr: float = 2e-3
    schedule: str = "halving"
    pieces: int = 8
    warmup: int = 0
    muon: float = 0.0
    clip: float = 0.0
    ema: float = 0.0
    moved: float = 1.0
    priors: tuple[tuple[str, float], ...] = (("woodham", 1.0),)
    passes: int = 1
    once: int = 0
    loss: str = "cosine"
    learn: str = ""
    gain: tuple[float, float] = (0.5, 2.0)
    intensities: tuple[float, float] = (1.0, 1.0)
    lights: str = ""
    turns: bool = False
    pixels: int = 0
    dark: float = 0.0
    rig: tuple[tuple[float, float, float], ...] = ()
    seed: int = 0
    validate: int = 2000
    exams: tuple[str, ...] = ("clean", "hemisphere")

    def __post_init__(self) -> None:
        if not 1 <= self.images[0] <= self.images[1]:
            raise InputError(f"images {self.images} came but (fewest, most) is needed, at least 1 each.")
        if self.schedule not in ("halving", "cosine", "flat"):
            raise InputError(f"no schedule {self.schedule!r}; choose halving, cosine or flat.")
        if self.loss not in ("cosine", "chord"):
            raise InputError(f"no loss {self.loss!r}; choose cosine or chord.")
        if not 0 < self.moved <= 1:
            raise InputError(f"moved {self.moved} came but a share above 0, at most 1, is needed.")

    @property
    def built(self) -> dict[str, Any]:
        """What builds the network: its config, with the lights of the rig that it learns for."""
        return self.config | ({"lights": self.rig} if self.rig else {})

    @property
    def rendered(self) -> dict[str, Any]:
        """What is changed in the renderer's recipe: as many lights as the network is shown, or those of the rig."""
        n = self.images[1]
        return {"lights": (n, n)} | self.rendering | ({"directions": self.rig} if self.rig else {})

    @property
    def rendered_only(self) -> str:
        """Why nothing but rendered scenes can be learned from; "": windows of samples on disk can, too."""
        if self.rig:
            return "a network for one rig learns from scenes under its lights"
        if self.lights or self.network == "lightsnet":
            return "lights are learned from whole objects, of which it holds windows"
        return ""

    def share(self, step: int, fraction: float) -> float:
        """Share of the peak rate at a step, when `fraction` of the training, [0, 1), is done."""
        rise = min(1.0, (step + 1) / self.warmup) if self.warmup else 1.0
        left = 1 - min(fraction, 1.0)
        if self.schedule == "halving":
            return rise * 0.5 ** int(self.pieces * min(fraction, 1 - 1e-9))
        fall = min(1.0, left / FALL) if self.schedule == "flat" else (1 - cos(pi * left)) / 2
        return rise * (0.01 + 0.99 * fall)

    def as_dict(self) -> dict[str, Any]:
        """The fields, as JSON has them."""
        return asdict(self)


# 40 epochs of 84,360 samples. A GPU learns faster than it renders; the paper uses every sample 40 times. What is not
# the paper's is the start: Muon, a warm-up, clipping; without them it can stay at the constant answer for long.
PAPER = Recipe(reuse=4, ring=256, muon=0.02, warmup=200, clip=1.0)
PSFCN = replace(PAPER, network="psfcn", priors=(), lr=1e-3, pieces=6, batch=32, steps=79_100)


def _paper(**config: Any) -> Recipe:
    return replace(PAPER, config=config)


NO_PRIOR = replace(_paper(prior=""), priors=())


CPU = replace(
    PAPER,
    config={"width": 32, "exchange": False},
    images=(4, 36),
    batch=16,
    steps=100_000,
    lr=5e-4,
    muon=0.005,
    schedule="cosine",
    ema=0.999,
    loss="chord",
    turns=True,
    reuse=4,
    ring=64,
    validate=3000,
)  # half of the paper network's width; at a rate of 0.02 Muon soon stands still here

# the networks of the paper's tables, each from the same scenes for the same minutes of a core, few images as often
# as many; examined at their end
COMPARED = replace(CPU, priors=(), validate=100_000)

# our own networks: Muon from the start, at a flat rate, so that a training can be made longer
OURS = Recipe(batch=32, lr=1e-3, schedule="flat", warmup=100, muon=0.02, clip=1.0, turns=True)

NORMALNET = replace(
    OURS,
    network="normalnet",
    rendering={"crop": 64, "crops": 2, "scenes": 64},
    reuse=4,
    images=(4, 96),
    steps=100_000,
    priors=(("trimmed", 0.35), ("woodham", 0.25), ("l1", 0.1), ("truth", 0.3)),
    passes=2,
    once=1500,
    loss="chord",
)

NORMALNET_CPU = replace(
    NORMALNET,
    rendering={"crop": 64, "crops": 2},
    images=(4, 48),
    batch=8,
    reuse=2,
    ema=0.999,
    once=3000,
    validate=3000,
)

# on from trained weights (--start-from), with modest cameras, too: rates of a tenth that fall at once
NORMALNET_ON = replace(
    NORMALNET_CPU,
    rendering={"crop": 64, "crops": 2, "dark": 0.25, "jpeg": 0.1, "gamma": 0.1, "clipped": 0.1},
    reuse=3,
    accumulate=2,
    lr=1e-4,
    muon=0.002,
    schedule="cosine",
    warmup=20,
    ema=0.98,
    moved=0.5,
    once=0,
    validate=150,
    exams=("clean", "hemisphere", "dark"),
)

# on from there, with hollow metal, too
NORMALNET_HOLLOW = replace(
    NORMALNET_ON, stream="train-and-hollow-metal", lr=5e-5, muon=0.001, exams=(*NORMALNET_ON.exams, "hollow-metal")
)

# whole objects, lights exactly known: what a network learns to say of them
LIGHTS = replace(
    OURS,
    network="lightsnet",
    rendering={
        "size": 64,
        "crop": 64,
        "crops": 1,
        "zoom": 0.0,
        "intensity_error": 0.0,
        "light_error_deg": 0.0,
        "corrupted": 0.1,
    },
    images=(6, 32),
    steps=60_000,
    ema=0.999,
    priors=(),
    intensities=(0.5, 2.0),
)

# SDPS-Net's second network: whole objects, as the network that finds lights needs them
UNDER_TOLD: dict[str, Any] = {
    "lights": "sdps-lights",
    "rendering": LIGHTS.rendering,
    "intensities": LIGHTS.intensities,
}
# networks that see each pixel by itself: a few pixels of many small windows; for twelve minutes of one core
PIXELS = replace(
    OURS,
    rendering={"crop": 8, "crops": 16},
    reuse=6,
    images=(8, 96),
    batch=64,
    steps=100_000,
    schedule="cosine",
    warmup=50,
    muon=0.01,
    ema=0.998,
    priors=(),
    loss="chord",
    pixels=4,
    validate=1_000_000,
)  # validated at the end: all pixels of four objects take a minute

RECIPES = {
    "paper": PAPER,
    # Table 1: what the prior is, where it enters, residual or plain
    "paper-no-prior": NO_PRIOR,
    "paper-prior-rpca": replace(_paper(prior="rpca"), priors=(("rpca", 1.0),)),
    "paper-plain": _paper(residual=False),
    "paper-concat-3": _paper(concat=3),
    "paper-concat-none": _paper(concat=0),
    # the extractor: blocks and branches
    "paper-3-blocks": _paper(blocks=3),
    "paper-5-blocks": _paper(blocks=5),
    "paper-7-blocks": _paper(blocks=7),
    "paper-single-branch": _paper(branches=1),
    "paper-independent-branches": _paper(exchange=False),
    # Tables 2 and 3: images seen in training
    "paper-10-images": replace(PAPER, images=(10, 10)),
    "paper-64-images": replace(PAPER, images=(64, 64)),
    # data amounts: the renderer's stand-ins for Blobby, Sculpture and both, in their proportion; or --data
    "paper-blobby": replace(PAPER, stream="blobs"),
    "paper-sculpture": replace(PAPER, stream="sculptures"),
    "paper-both": replace(PAPER, stream="blobs-and-sculptures"),
    "paper-blobby-no-prior": replace(NO_PRIOR, stream="blobs"),
    "paper-sculpture-no-prior": replace(NO_PRIOR, stream="sculptures"),
    "paper-both-no-prior": replace(NO_PRIOR, stream="blobs-and-sculptures"),
    # the baselines in the same conditions
    "psfcn": PSFCN,
    "psfcn-normalised": replace(PSFCN, config={"normalised": True}),
    "cnn-ps": replace(PIXELS, network="cnn-ps"),
    # 7 degrees a cell, over 70: domes, too; few lights as often as many
    "lmps": replace(PIXELS, network="lmps", config={"side": 20, "reach_deg": 70}, images=(4, 96), pixels=8, dark=0.05),
    # is shown 4 samples to all of them while it learns
    "spline-net": replace(PIXELS, network="spline-net", config={"width": 8}, images=(16, 96)),
    # learned for one rig, whose lights are given
    "dpsn": replace(
        PIXELS, network="dpsn", config={"width": 1024}, batch=128, pixels=32, turns=False, dark=0.05, exams=("clean",)
    ),
    "gps-net": replace(COMPARED, network="gps-net", lr=2e-3, config={}),
    "attention-psn": replace(
        COMPARED, network="attention-psn", config={"width": 16, "shallow": 2, "deep": 4}, loss="cosine"
    ),
    "dr-psn": replace(COMPARED, network="dr-psn", config={"width": 32}),
    # normalnet; the recipes called cpu are for hours on a processor
    "cpu": CPU,
    "psfcn-cpu": replace(COMPARED, network="psfcn", config={"width": 32}),
    "psfcn-normalised-cpu": replace(COMPARED, network="psfcn", config={"width": 32, "normalised": True}),
    "normalnet": NORMALNET,
    "normalnet-cpu": NORMALNET_CPU,
    "normalnet-on": NORMALNET_ON,
    "normalnet-hollow": NORMALNET_HOLLOW,
    "sdps-lights": LIGHTS,
    "sdps-lights-cpu": replace(LIGHTS, images=(6, 24), batch=8, reuse=4, ring=64),
    "sdps": replace(PSFCN, images=(6, 32), **UNDER_TOLD),
    "sdps-cpu": replace(
        CPU,
        network="psfcn",
        config={"width": 32},
        priors=(),
        images=(6, 24),
        batch=8,
        warmup=200,
        **UNDER_TOLD,
    ),  # on top of psfcn's weights (--start-from)
    "normalnet-expected": replace(
        NORMALNET_CPU,
        images=(4, 64),
        batch=4,
        steps=4000,
        warmup=50,
        priors=(("trimmed", 1.0),),
        once=0,
        learn="doubt",
        validate=2000,
    ),  # on top of trained weights (--start-from): only how far each normal is expected to be off
}


def for_rig(recipe: Recipe, lights: np.ndarray | None) -> Recipe:
    """A recipe under a rig's lights (n, 3); InputError where its network needs none, or lacks them."""
    if (lights is None) == (recipe.network in ONE_RIG and not recipe.rig):
        if lights is None:
            raise InputError(f"{recipe.network} learns for one rig; name its lights with --lights.")
        raise InputError(f"--lights came but {recipe.network} learns for any lights; leave it out.")
    if lights is None:
        return recipe
    L = lights / np.linalg.norm(lights, axis=1, keepdims=True)
    rig = tuple((x, y, z) for x, y, z in L.round(6).tolist())
    return replace(recipe, rig=rig, images=(len(rig), len(rig)))


def recipe(name: str) -> Recipe:
    """A recipe by its name."""
    return by_name("recipe", name, RECIPES)
