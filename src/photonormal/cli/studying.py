"""Commands for studies: benchmarks, tables and figures, rendered captures, training."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, UseAppendAction

from photonormal.cli.kinds import Folder, Name, Names, Where, shown
from photonormal.options import Angle, Count, Positive, Precision, Seed, Whole
from photonormal.types import InputError


@dataclass(frozen=True)
class Bench:
    """Predict the normals of a benchmark's objects by several methods, and store them."""

    benchmark: Positional[Annotated[str, tyro.conf.arg(metavar="BENCHMARK")]]
    """diligent, captures (your own, each with Normal_gt.mat), materials, cycles, blobby or lightstage."""
    root: Positional[Path]
    """Folder with the benchmark's objects; absent ones are left blank."""
    out: Path = Path("runs")
    """Folder of the predictions; what it holds is not predicted again."""
    methods: Annotated[str, tyro.conf.arg(metavar="NAMES")] = "all"
    """Methods like woodham,l1; one may enter again as label=method:option=value."""
    images: Annotated[str, tyro.conf.arg(metavar="COUNTS")] = "all"
    """How many images: all, or counts like 10 or 8,16,96."""
    draws: Whole = 10
    """Random draws of fixed seeds where fewer than all images are used, besides the one of PS-FCN's code."""
    fixed: Annotated[tuple[Path, ...], shown("FILE")] = ()
    """Text files with image numbers like 1-10,15, or lines `object: 1-10,15`."""
    objects: Names = ""
    """Only these objects, like ball,cat."""
    device: Where = "auto"
    """Where methods compute."""
    precision: Precision = "auto"
    """What networks compute in: float32 or bf16; auto: bf16 where the machine has instructions for it."""
    jobs: Count = 1
    """Objects at a time; more than one disturbs the seconds measured."""
    srgb: bool = False
    """The photographs of `captures` are sRGB-encoded; by default their profile or Exif data is believed."""

    def __call__(self) -> int:
        from photonormal.bench import bench

        done = bench(
            self.benchmark,
            self.root,
            self.out,
            methods=self.methods,
            images=self.images,
            draws=self.draws,
            fixed=self.fixed,
            objects=self.objects,
            device=self.device,
            precision=self.precision,
            jobs=self.jobs,
            srgb=self.srgb,
        )
        for failure in done.failures:
            print(f"photonormal: {failure}", file=sys.stderr)
        print(f"{done.predicted} predictions stored in {self.out}, {done.kept} were there, {len(done.failures)} failed")
        return 1 if done.failures else 0


@dataclass(frozen=True)
class Table:
    """Tables of stored predictions: errors, published figures beside them, seconds and memory."""

    runs: Positional[Path]
    """Folder that `bench` wrote."""
    markdown: bool = False
    """Print Markdown, which is the default."""
    json: bool = False
    """Print JSON."""
    latex: bool = False
    """Print LaTeX."""
    methods: Names = ""
    """Only these, like woodham,l1."""
    datasets: Names = ""
    """Only these, like diligent."""
    published: bool = False
    """Add published figures of methods that are not in photonormal."""

    def __call__(self) -> int:
        from photonormal.bench.formats import FORMATS
        from photonormal.bench.tables import tables

        chosen = [name for name in FORMATS if getattr(self, name)] or ["markdown"]
        if len(chosen) > 1:
            raise InputError(f"--{' and --'.join(chosen)} came but one format is printed; choose one.")
        found = tables(self.runs, listed(self.methods), listed(self.datasets), self.published)
        print(FORMATS[chosen[0]](found), end="")
        return 0


@dataclass(frozen=True)
class Figure:
    """A figure from stored predictions, or from training logs, as PNG and PDF."""

    name: Positional[Annotated[str, tyro.conf.arg(metavar="FIGURE")]]
    """errors, normals, images, seconds, materials or convergence."""
    places: Positional[Annotated[tuple[str, ...], shown("RUNS")]]
    """The folder that `bench` wrote; for convergence, folders of trainings, as FOLDER or LABEL=FOLDER."""
    out: Folder = None
    """Folder to write into; by default `figures` in the folder of runs."""
    dataset: Name = ""
    """Which dataset, where the runs hold several."""
    methods: Names = ""
    """Only these, like woodham,l1, in this order."""
    objects: Names = ""
    """Only these, like ball,cat, in this order."""
    limit: Annotated[Angle | None, shown("N")] = None
    """Error in degrees of the last colour of error maps."""
    overwrite: bool = False
    """Replace files that exist in OUT."""

    def __call__(self) -> int:
        from photonormal.bench.figures import figure

        methods, objects = listed(self.methods), listed(self.objects)
        for path in figure(
            self.name, self.places, self.out, self.dataset, methods, objects, self.limit, self.overwrite
        ):
            print(path)
        return 0


@dataclass(frozen=True)
class Report:
    """One HTML file with tables to sort, maps to compare and surfaces to turn; it needs no server or network."""

    runs: Positional[Path]
    """Folder that `bench` wrote."""
    out: Path = Path("report.html")
    """File to write."""
    methods: Names = ""
    """Only these, like woodham,l1."""
    datasets: Names = ""
    """Only these, like diligent."""
    objects: Names = ""
    """Objects to show maps of; by default up to 12 of each dataset."""
    surfaces: bool = True
    """Integrate the normals of each object's best method."""
    overwrite: bool = False
    """Replace a file that exists."""

    def __call__(self) -> int:
        from photonormal.bench.page import write_page

        path = write_page(
            self.runs,
            self.out,
            methods=listed(self.methods),
            datasets=listed(self.datasets),
            shown=listed(self.objects),
            surfaces=self.surfaces,
            overwrite=self.overwrite,
        )
        print(path)
        return 0


def listed(text: str) -> list[str]:
    """The names in `a,b`."""
    return [name.strip() for name in text.split(",") if name.strip()]


@dataclass(frozen=True)
class Render:
    """Rendered captures with exact normals."""

    recipe: Positional[Annotated[str, tyro.conf.arg(metavar="RECIPE")]]
    """What is rendered: objects, demo, train, validation and others; a wrong name lists them."""
    out: Path
    """Folder to write; it must not exist yet, or be empty."""
    count: Count = 1
    """How many samples."""
    preview: bool = False
    """Write contact-sheet.png, too."""
    layout: Annotated[str | None, shown("NAME")] = None
    """diligent (a folder each, for `measure`), blobby or shards; by default the recipe's own."""
    device: Where = "auto"
    """Where it is rendered."""
    seed: Seed = 0
    """Another seed, other samples."""

    def __call__(self) -> int:
        from photonormal.methods.engine.device import torch_device
        from photonormal.progress import progress
        from photonormal.synth.output import render

        device = torch_device(self.device)
        with progress(f"rendering {self.recipe}", self.count) as advance:
            folder = render(
                self.recipe,
                self.count,
                self.out,
                preview=self.preview,
                progress=lambda done, count: advance(),
                layout=self.layout,
                device=device,
                seed=self.seed,
            )
        print(folder)
        return 0


@dataclass(frozen=True)
class Train:
    """Train a network; stopped at any moment it goes on from its last checkpoint with --resume."""

    recipe: Positional[Annotated[str, tyro.conf.arg(metavar="RECIPE")]]
    """What is learned: paper, cpu, normalnet and others; a wrong name lists them."""
    out: Path
    """Folder for checkpoint, journal, TensorBoard and weights."""
    data: UseAppendAction[tuple[Path, ...]] = ()
    """A set to learn from in place of rendered scenes; repeat it for several. Blobby, Sculpture, shards or DiLiGenT."""
    lights: Annotated[Path | None, shown("FILE")] = None
    """Lights of the rig that a network is learned for, such as dpsn."""
    minutes: Annotated[Positive | None, shown("N")] = None
    """Minutes of learning; the schedule stretches to them. Rendering and taking exams come on top, and are told."""
    steps: Annotated[Count | None, shown("N")] = None
    """Length in place of the recipe's."""
    resume: bool = False
    """Go on from the checkpoint in OUT."""
    device: Where = "auto"
    """Where it learns; on several devices by torchrun."""
    seed: Seed = 0
    """Of the weights and of the scenes: another seed never sees the same ones."""
    start_from: Annotated[Path | None, shown("FILE")] = None
    """Weights file to begin with, in place of random weights."""
    name: Name = ""
    """Of the weights file; by default the recipe's."""
    precision: Precision = "auto"
    """What the network computes in: float32 or bf16; auto: as before with --resume, else as `measure` does."""

    def __call__(self) -> int:
        import logging

        from photonormal.train import train

        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
        print(
            train(
                self.recipe,
                self.out,
                minutes=self.minutes,
                steps=self.steps,
                resume=self.resume,
                device=self.device,
                seed=self.seed,
                start_from=self.start_from,
                name=self.name,
                precision=self.precision,
                data=self.data,
                lights=self.lights,
            )
        )
        return 0
