"""The benchmarks: which objects a root holds, in which order, and how each is read."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photonormal.capture import UNKNOWN, load
from photonormal.capture.pictures import natural, picture_files
from photonormal.types import Capture, InputError, by_name

DILIGENT = ("ball", "bear", "buddha", "cat", "cow", "goblet", "harvest", "pot1", "pot2", "reading")
FAULTY = {"bear": 20}  # first pictures of an object that are wrong, by the readme of CNN-PS's code
FILES = {  # layout -> files that every object of a benchmark has
    "diligent": ("filenames.txt", "light_directions.txt", "light_intensities.txt", "mask.png", "Normal_gt.mat"),
    "cyclesps": ("light.txt", "gt_normal.tif", "inboundary.png"),
    "lightstage": (),
    "blobby": (),
}


@dataclass(frozen=True)
class Item:
    """One object of a benchmark.

    Parameters
    ----------
    dataset : as the folder of its predictions is called
    name : as tables call the object
    index : its place in the benchmark's own order, which seeds its draws
    path, format : where `photonormal.load` reads it
    needed : files beside the pictures that must be there
    protocol : "paper": one augmented crop, as the paper validates; "": the capture itself
    truth : true normals have to be there
    srgb : its photographs are linearised, whatever their files say
    """

    dataset: str
    name: str
    index: int
    path: Path
    format: str
    needed: tuple[Path, ...] = ()
    protocol: str = ""
    truth: bool = True
    srgb: bool = False

    def load(self, lights: bool = True) -> Capture:
        """Its capture, with its lights and their intensities or without; InputError where a file is missing."""
        missing = [str(p) for p in self.needed if not p.is_file()]
        if missing:
            other = ", or use `bench captures`, which takes any layout" if self.format == "diligent" else ""
            raise InputError(f"{', '.join(missing)} is missing; restore it, remove the object's folder{other}.")
        capture = load(self.path, format=self.format, lights=None if lights else UNKNOWN, srgb=self.srgb)
        if self.truth and capture.truth is None:
            raise InputError(f"{self.path} has no true normals to score against; add them or remove the object.")
        if self.protocol == "paper":
            from photonormal.capture.augmentation import augmented

            return augmented(capture, np.random.default_rng(self.index))
        return capture


def items(benchmark: str, root: Path) -> list[Item]:
    """The objects of a benchmark that `root` holds, complete or not.

    Raises
    ------
    InputError
        If the benchmark does not exist or the root holds no object of it.
    """
    find, layout = by_name("benchmark", benchmark, BENCHMARKS)
    if not root.is_dir():
        raise InputError(f"{root} is no folder; give the root of {benchmark}.")
    found = find(root)
    if not found:
        raise InputError(f"{root} holds no objects of {benchmark}; {layout}.")
    return found


def _diligent(root: Path) -> list[Item]:
    found = {p.name.removesuffix("PNG"): p for p in _diligent_folders(root)}
    order = list(DILIGENT) + sorted(set(found) - set(DILIGENT))
    return [_in_diligent_layout("diligent", name, order.index(name), found[name]) for name in order if name in found]


def _materials(root: Path) -> list[Item]:
    """One object in many materials; the root's name says which object."""
    folders, dataset = _diligent_folders(root), f"materials-{root.resolve().name}"
    return [_in_diligent_layout(dataset, p.name.removesuffix("PNG"), i, p) for i, p in enumerate(folders)]


def _captures(root: Path) -> list[Item]:
    """Captures in any layout; the root's name says which they are."""
    folders = [p for p in _folders(root) if picture_files(p) or (p / "Normal_gt.mat").is_file()]
    return [Item(f"captures-{root.resolve().name}", p.name, i, p, "auto") for i, p in enumerate(folders)]


def _diligent_folders(root: Path) -> list[Path]:
    """Folders of objects, also those that lack files; `root` may be one level above them."""
    for folder in (root / "pmsData", root):
        found = [p for p in _folders(folder) if any((p / name).is_file() for name in FILES["diligent"])]
        if found:
            return found
    return []


def _in_diligent_layout(dataset: str, name: str, index: int, path: Path) -> Item:
    return Item(dataset, name, index, path, "diligent", tuple(path / f for f in FILES["diligent"]))


def _cycles(root: Path) -> list[Item]:
    """Renderings of `<object>.obj` folders, in `root` or one level below; the count of lights shows the dataset.

    Pictures that this package rendered go by another name: what is published on CyclesPSTest says nothing about them.
    """
    found = []
    ours = any((folder / "set.json").is_file() for folder in (root, root.resolve().parent))
    for folder in [root, *_folders(root)]:
        for path in _folders(folder):
            if not path.name.endswith(".obj") and not any((path / f).is_file() for f in FILES["cyclesps"][:2]):
                continue
            kinds = [p for p in _folders(path) if p.name.startswith("images_")] or [path]
            needed = tuple(path / f for f in FILES["cyclesps"])
            count = _lines(path / "light.txt")
            for kind in kinds:
                name = f"{path.name.removesuffix('.obj')} {kind.name.removeprefix('images_') if kind != path else ''}"
                found.append(
                    Item(f"{'rendered-' * ours}cycles{count or ''}", name.strip(), len(found), kind, "cyclesps", needed)
                )
    return found


def _blobby(root: Path) -> list[Item]:
    """The validation samples twice: as they are, and as the paper's validation sees them."""
    from photonormal.capture.blobby import listed_samples

    lists = root / "val_mtrl.txt"
    if not lists.is_file():
        return []
    found = []
    for dataset, protocol in (("blobby", ""), ("blobby-paper", "paper")):
        for i, path in enumerate(listed_samples(lists)):
            shape = path.parent
            needed = (shape / f"{shape.name}_normal.png", path / f"{shape.name}_{path.name}.txt")
            found.append(Item(dataset, f"{shape.name}/{path.name}", i, path, "blobby", needed, protocol))
    return found


def _lightstage(root: Path) -> list[Item]:
    if not (root / "light_directions.txt").is_file():
        return []
    needed = (root / "light_directions.txt", root / "light_intensities.txt")
    folders = [p for p in _folders(root) if any(p.glob("*_matte.*"))]
    return [Item("lightstage", p.name, i, p, "lightstage", needed, truth=False) for i, p in enumerate(folders)]


BENCHMARKS: dict[str, tuple[Callable[[Path], list[Item]], str]] = {  # name -> how objects are found, what is needed
    "diligent": (
        _diligent,
        "give DiLiGenT, its pmsData, or a folder of objects in its layout; captures in any other are `bench captures`",
    ),
    "materials": (_materials, "give a folder with one object in DiLiGenT's layout for each material"),
    "captures": (_captures, "give a folder of captures as `measure` reads them, each with Normal_gt.mat"),
    "cycles": (_cycles, "give a folder of NAME.obj folders with light.txt and gt_normal.tif"),
    "blobby": (_blobby, "give the root of a Blobby or Sculpture set, with val_mtrl.txt"),
    "lightstage": (_lightstage, "give the folder with light_directions.txt and the objects' folders with mattes"),
}


def _folders(folder: Path) -> list[Path]:
    if not os.path.isdir(folder):
        return []
    return sorted(
        (p for p in folder.iterdir() if p.is_dir() and not p.name.startswith(".")), key=lambda p: natural(p.name)
    )


def _lines(path: Path) -> int:
    return sum(bool(line.strip()) for line in path.read_text(errors="replace").splitlines()) if path.is_file() else 0
