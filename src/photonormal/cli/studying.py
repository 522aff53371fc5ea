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
    """Run several methods on a benchmark's objects, and store their normals."""

    benchmark: Positional[Annotated[str, tyro.conf.arg(metavar="BENCHMARK")]]
    """diligent, captures (your own, each with a Normal_gt.mat), materials, cycles, blobby or lightstage."""
    root: Positional[Path]
    """Folder with the benchmark's objects; objects that are missing stay blank in tables."""
    out: Path = Path("runs")
    """Folder for the predictions; those that it holds are kept."""
    methods: Annotated[str, tyro.conf.arg(metavar="NAMES")] = "all"
    """Methods, such as woodham,l1; label=method:option=value adds one with other options under a label."""
    images: Annotated[str, tyro.conf.arg(metavar="COUNTS")] = "all"
    """How many images to use: all, or counts such as 10 or 8,16,96."""
    draws: Whole = 10
    """Random subsets with fixed seeds, if fewer than all images are used; the subset of PS-FCN's code comes on top."""
    fixed: Annotated[tuple[Path, ...], shown("FILE")] = ()
    """Text files with the images to use: numbers such as 1-10,15, or lines `object: 1-10,15`."""
    objects: Names = ""
    """Only these objects, such as ball,cat."""
    device: Where = "auto"
    """Where methods compute; auto: on a GPU if there is one."""
    precision: Precision = "auto"
    """Number format of networks; auto: bf16 where the machine has instructions for it, else float32."""
    jobs: Count = 1
    """How many objects run at a time; with more than one, the seconds in tables are no good."""
    srgb: bool = False
    """The photographs of `captures` are sRGB-encoded; by default their profile or Exif data decides."""

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
    """Print tables of stored predictions: errors, published figures, seconds and memory."""

    runs: Positional[Path]
    """Folder that `bench` wrote."""
    markdown: bool = False
    """Print Markdown, which is the default."""
    json: bool = False
    """Print JSON."""
    latex: bool = False
    """Print LaTeX."""
    methods: Names = ""
    """Only these methods, such as woodham,l1."""
    datasets: Names = ""
    """Only these datasets, such as diligent."""
    published: bool = False
    """Add published figures of methods that photonormal does not have."""

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
    """Draw a figure of stored predictions or of training logs, as PNG and PDF."""

    name: Positional[Annotated[str, tyro.conf.arg(metavar="FIGURE")]]
    """errors, normals, images, seconds, materials or convergence."""
    places: Positional[Annotated[tuple[str, ...], shown("RUNS")]]
    """Folder that `bench` wrote; for convergence, folders that `train` wrote, as FOLDER or LABEL=FOLDER."""
    out: Folder = None
    """Folder to write into; by default `figures` in the folder of runs."""
    dataset: Name = ""
    """Dataset to draw, if the runs hold several."""
    methods: Names = ""
    """Only these methods, such as woodham,l1, in this order."""
    objects: Names = ""
    """Only these objects, such as ball,cat, in this order."""
    limit: Annotated[Angle | None, shown("N")] = None
    """Error in degrees at which the colours of error maps end."""
    overwrite: bool = False
    """Replace files that exist in --out."""

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
    """Write stored predictions as one HTML file: tables to sort, maps to compare, surfaces to turn."""

    runs: Positional[Path]
    """Folder that `bench` wrote."""
    out: Path = Path("report.html")
    """File to write."""
    methods: Names = ""
    """Only these methods, such as woodham,l1."""
    datasets: Names = ""
    """Only these datasets, such as diligent."""
    objects: Names = ""
    """Objects whose maps are shown; by default up to 12 of each dataset."""
    surfaces: bool = True
    """Show the surface of each object, integrated from the normals of its best method."""
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
    """Render captures with exact normals."""

    recipe: Positional[Annotated[str, tyro.conf.arg(metavar="RECIPE")]]
    """What to render: objects, demo, train, validation and others; a wrong name lists them all."""
    out: Path
    """Folder to write; it must be new or empty."""
    count: Count = 1
    """How many samples to render."""
    preview: bool = False
    """Write contact-sheet.png, too."""
    layout: Annotated[str | None, shown("NAME")] = None
    """diligent (a folder for each sample, for `measure`), blobby or shards; by default the recipe's own."""
    device: Where = "auto"
    """Where to render; auto: on a GPU if there is one."""
    seed: Seed = 0
    """Another seed gives other samples."""

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
    """Train a network. You may stop it at any moment; --resume goes on from the last checkpoint."""

    recipe: Positional[Annotated[str, tyro.conf.arg(metavar="RECIPE")]]
    """What to train: paper, cpu, normalnet and others; a wrong name lists them all."""
    out: Path
    """Folder for the checkpoint, the journal, TensorBoard and the weights."""
    data: UseAppendAction[tuple[Path, ...]] = ()
    """Set to learn from instead of rendered scenes: Blobby, Sculpture, shards or DiLiGenT. Repeat it for several."""
    lights: Annotated[Path | None, shown("FILE")] = None
    """Lights of the rig, for networks such as dpsn that learn for one rig."""
    minutes: Annotated[Positive | None, shown("N")] = None
    """Minutes of learning, to which the schedule stretches. Rendering and validation take more time; it is printed."""
    steps: Annotated[Count | None, shown("N")] = None
    """Number of steps, instead of the recipe's."""
    resume: bool = False
    """Go on from the checkpoint in --out."""
    device: Where = "auto"
    """Where to train; torchrun trains on several devices."""
    seed: Seed = 0
    """Seed of the weights and of the scenes; another seed never sees the same scenes."""
    start_from: Annotated[Path | None, shown("FILE")] = None
    """Weights file to start with, instead of random weights."""
    name: Name = ""
    """Name of the weights file; by default the recipe's."""
    precision: Precision = "auto"
    """Number format of the network; auto: as before with --resume, else as `measure` chooses."""

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
