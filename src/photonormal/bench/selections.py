"""Which images of an object are used: all, seeded draws, the one draw of PS-FCN's code, or a user's own choice."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photonormal.bench.benchmarks import FAULTY, Item
from photonormal.capture.pictures import parse_images
from photonormal.stored import stored_bytes
from photonormal.types import Capture, Image, Images, InputError, window_of


@dataclass(frozen=True)
class Selection:
    """Some images of one object.

    Parameters
    ----------
    name : "" for all; else as the file of the prediction calls it
    protocol : "all", "sound" (all but the pictures known to be wrong), "draws", "psfcn" or "fixed-<name>"
    images : indices from 0
    """

    name: str
    protocol: str
    images: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """What to select of every object.

    Parameters
    ----------
    counts : numbers of images; 0: all
    draws : random draws where a count is below an object's images
    fixed : name -> (object or "" for every object -> numbers like "1-10,15")
    """

    counts: tuple[int, ...]
    draws: int
    fixed: dict[str, dict[str, str]]

    @staticmethod
    def parse(images: str, draws: int, fixed: tuple[Path, ...]) -> Plan:
        """From the command line: "96", "10", "all" or "8,10,16"; files as `read_fixed` reads them."""
        counts = []
        for part in images.split(","):
            text = part.strip()
            if text != "all" and not (text.isdecimal() and int(text) >= 3):
                raise InputError(
                    f"--images {images!r} has {text!r} but all or counts of at least 3, like 10 or 8,16,96, are needed."
                )
            counts.append(0 if text == "all" else int(text))
        if draws < 0:
            raise InputError(f"--draws {draws} came but 0 or more are needed.")
        names = [path.stem for path in fixed]
        if len(set(names)) != len(names):
            raise InputError(f"two files of --fixed are called {sorted(names, key=names.count)[-1]}; rename one.")
        return Plan(tuple(dict.fromkeys(counts)), draws, {path.stem: read_fixed(path) for path in fixed})

    def of(self, item: Item, n: int) -> list[Selection]:
        """The selections of an object with `n` images."""
        found = []
        for k in self.counts:
            if k > n:
                raise InputError(f"{item.name} has {n} images but {k} are asked for; ask for fewer with --images.")
            if k in (0, n):
                found.append(Selection("", "all", tuple(range(n))))
                skip = FAULTY.get(item.name, 0) if item.dataset == "diligent" else 0
                if 0 < skip < n - 3:
                    found.append(Selection(f"{skip + 1}-{n}", "sound", tuple(range(skip, n))))
                continue
            found += [Selection(f"{k}-{d:03d}", "draws", draw(item.index, d, n, k)) for d in range(self.draws)]
            found.append(Selection(f"{k}-psfcn", "psfcn", psfcn_draw(item.index, n, k)))
        for name, choices in self.fixed.items():
            if text := choices.get(item.name, choices.get("", "")):
                chosen = tuple(parse_images(text, n))
                if len(chosen) < 3:
                    raise InputError(
                        f"--fixed {name} gives {len(chosen)} images for {item.name}; at least 3 are needed."
                    )
                found.append(Selection(f"fixed-{name}", f"fixed-{name}", chosen))
        return found


def draw(index: int, d: int, n: int, k: int) -> tuple[int, ...]:
    """Draw `d` of `k` of the `n` images of the object `index`; the same in every run."""
    return tuple(int(j) for j in np.sort(np.random.default_rng((d, index, k)).permutation(n)[:k]))


def psfcn_draw(index: int, n: int, k: int) -> tuple[int, ...]:
    """The draw that PS-FCN's code and its descendants make: legacy generator, seeded by the object's index."""
    return tuple(int(j) for j in np.sort(np.random.RandomState(index).permutation(n)[:k]))


def read_fixed(path: Path) -> dict[str, str]:
    """Numbers from 1, as ``1-10,15`` for every object, or a line ``object: 1-10,15`` for each."""
    advice = "give a text file with image numbers like 1-10,15"
    try:
        text = stored_bytes(path, advice, 2**20).decode()
    except UnicodeDecodeError:
        raise InputError(f"{path} can't be read (it is no text); {advice}.") from None
    found: dict[str, str] = {}
    for i, line in enumerate(text.splitlines()):
        name, _, numbers = (part.strip() for part in line.split("#")[0].rpartition(":"))
        if not (name or numbers):
            continue
        if not re.fullmatch(r"[\d\s,-]+", numbers) or name in found:  # what else it says is nobody's business
            raise InputError(f"{path}, line {i + 1}: one line like 1-10,15, or object: 1-10,15 for each, is needed.")
        found[name] = numbers
    if not found:
        raise InputError(f"{path} is empty; write image numbers like 1-10,15 into it.")
    return found


@dataclass(frozen=True)
class Chosen:
    """Some pictures of others, which are decoded once for all."""

    images: Images
    indices: tuple[int, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return (len(self.indices), *self.images.shape[1:])

    def __getitem__(self, j: int, /) -> Image:
        return self.images[self.indices[j]]

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of one picture."""
        return window_of(self.images, self.indices[j], rows, columns)


def selected(capture: Capture, selection: Selection) -> Capture:
    """The capture with the selected images only."""
    if len(selection.images) == capture.images.shape[0]:
        return capture
    chosen = list(selection.images)
    return replace(
        capture,
        images=Chosen(capture.images, selection.images),
        lights=None if capture.lights is None else capture.lights[chosen],
        lamps=None if capture.lamps is None else capture.lamps[chosen],
        saturation=None if capture.saturation is None else capture.saturation[chosen],
        image_names=tuple(capture.image_names[j] for j in chosen),
    )
