"""The Blobby and Sculpture sets (Chen et al., ECCV 2018), and what is rendered in their layout.

SET/
    train_mtrl.txt, val_mtrl.txt    lines `shape/material`
    Images/shape/material/          one sample: `photonormal.capture.blobby`
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import ClassVar

import numpy as np

from photonormal.capture import blobby
from photonormal.capture.assemble import Choice
from photonormal.files.decode import frame_of
from photonormal.train.sets import SampleSet, Shape
from photonormal.types import Capture, InputError

LISTS = ("train_mtrl.txt", "val_mtrl.txt")


class BlobbySet(SampleSet):
    """Samples by `shape/material`, split as the set's own lists say."""

    layout: ClassVar[str] = "blobby"
    exposed: ClassVar[bool] = True

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        for name in LISTS:
            if not (root / name).is_file():
                raise InputError(f"{root} has no {name} but its split is needed; restore the set's own lists.")
        self.training, self.validation = (tuple(blobby.keys(root / name)) for name in LISTS)

    @classmethod
    def matches(cls, root: Path) -> bool:
        return (root / "Images").is_dir() or any((root / name).is_file() for name in LISTS)

    def folder(self, key: str) -> Path:
        """A sample's folder, or an error that names the list that names it."""
        return self.root / "Images" / key

    def shape(self, key: str) -> Shape:
        folder = self.folder(key)
        try:
            there = set(os.listdir(folder))
        except OSError as error:
            name = LISTS[key in self.validation and key not in self.training]
            raise InputError(
                f"{self.root / name} names {key} but {folder} can't be read ({error.strerror}); restore it or take it "
                "off the list."
            ) from None
        names, lights = blobby.listed(folder)
        if not names:
            raise InputError(f"the list of sample {key} of {self.root} is empty; restore it.")
        missing = [name for name in names if name not in there]
        if missing:
            more = f", and {len(missing) - 1} more," if len(missing) > 1 else ""
            raise InputError(
                f"picture {folder / missing[0]} is missing{more} but the sample's list names it; restore it."
            )
        length = np.linalg.norm(lights, axis=1)
        usable = np.isfinite(length) & (length > 0)
        if not usable.all():
            dark = folder / names[int(usable.argmin())]
            raise InputError(f"the light of {dark} is no direction but the list needs one; correct it.")
        sizes = {path: frame_of(path) for path in [blobby.normal_map(folder), *(folder / name for name in names)]}
        h, w = Counter(sizes.values()).most_common(1)[0][0]
        for path, (rows, columns) in sizes.items():
            if (rows, columns) != (h, w):
                raise InputError(
                    f"{path} has {rows} x {columns} pixels but the rest of its sample has {h} x {w}; restore it."
                )
        return Shape(len(names), h, w)

    def read(self, key: str) -> Capture:
        return blobby.read(self.folder(key), Choice())
