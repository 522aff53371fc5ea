"""Sets of samples on disk to learn from: one layout, one file. What they hold is checked before anything is trained."""

from __future__ import annotations

import hashlib
import logging
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from photonormal.lookup import lookup
from photonormal.progress import progress
from photonormal.resources import cores
from photonormal.types import Capture, InputError

log = logging.getLogger(__name__)

LAYOUTS = {  # name -> "module:Class", imported only when asked for; the first that matches reads
    "blobby": "photonormal.train.sets.blobby:BlobbySet",
    "shards": "photonormal.train.sets.shards:ShardSet",
    "diligent": "photonormal.train.sets.objects:ObjectSet",
}
TOGETHER = 64  # samples that a thread checks at a time


class Shape(NamedTuple):
    """What a sample looks like, by its lists and headers."""

    pictures: int
    rows: int
    columns: int


class SampleSet(ABC):
    """One set.

    Attributes
    ----------
    root : its folder
    training, validation : keys of the samples in each part of its split
    exposed : whether its pictures never met a camera: gain and noise come at run time
    decoded : whether reading a sample costs no decoding, so that it need not be kept
    alike : whether all its samples have as many pictures, of one size
    """

    layout: ClassVar[str]
    exposed: ClassVar[bool] = False
    decoded: ClassVar[bool] = False
    alike: ClassVar[bool] = True
    training: Sequence[str]
    validation: Sequence[str] = ()

    def __init__(self, root: Path) -> None:
        self.root = root

    @classmethod
    @abstractmethod
    def matches(cls, root: Path) -> bool:
        """Whether a folder has this layout, whole or not."""

    @abstractmethod
    def shape(self, key: str) -> Shape:
        """What a sample looks like; InputError where something of it is missing. No picture is decoded."""

    @abstractmethod
    def read(self, key: str) -> Capture:
        """A sample, with lights and true normals; pictures may be decoded when they are asked for."""

    @property
    def name(self) -> str:
        return self.root.resolve().name

    def told(self) -> dict[str, Any]:
        """What a checkpoint and a card say of the set; equal where the samples have the same names."""
        names = "\n".join([*self.training, "", *self.validation])
        counts = {"training": len(self.training), "validation": len(self.validation)}
        digest = hashlib.sha256(names.encode()).hexdigest()
        return {"name": self.name, "layout": self.layout, **counts, "sha256": digest}


def opened(folders: Sequence[str | Path]) -> list[SampleSet]:
    """The sets in some folders, their lists read, their samples not looked at yet."""
    sets = [_opened(Path(folder)) for folder in folders]
    for s in sets:
        if not s.training:
            raise InputError(f"{s.root} lists no sample to learn from; give a set that has some.")
    return sets


def _opened(root: Path) -> SampleSet:
    if not root.is_dir():
        raise InputError(f"{root} is no folder but --data needs a set of samples; give the folder of one.")
    for layout in map(lookup, LAYOUTS.values()):
        if layout.matches(root):
            return layout(root)
    raise InputError(
        f"{root} holds no training set; give a Blobby or Sculpture set (train_mtrl.txt, val_mtrl.txt, Images), "
        "shards that `photonormal render` wrote, or a folder of objects in DiLiGenT's layout."
    )


def fewest_pictures(sets: Sequence[SampleSet]) -> int:
    """Pictures of the sample that has fewest; where all of a set are alike its first is looked at."""
    keys = ((s, [*s.training, *s.validation]) for s in sets)
    return min(s.shape(key).pictures for s, some in keys for key in (some[:1] if s.alike else some))


def check_samples(sets: Sequence[SampleSet], images: int, crop: int) -> None:
    """Look at every sample's lists and headers.

    Raises
    ------
    InputError
        Naming the first sample that lacks something, is smaller than `crop`, has fewer than `images` pictures, or
        another number or size than the rest of its set.
    """
    start, count = time.monotonic(), sum(len(s.training) + len(s.validation) for s in sets)
    with progress(f"checking {count:,} samples", count) as advance:
        for s in sets:
            found = {}
            for key, shape in _shapes(s):
                found[key] = shape
                advance()
            usual = Counter(found.values()).most_common(1)[0][0]
            for key, shape in found.items():
                _compare(s, key, shape, usual, images, crop)
    log.info("%s samples of %d sets checked in %.1f s", f"{count:,}", len(sets), time.monotonic() - start)


def _shapes(s: SampleSet) -> Iterator[tuple[str, Shape]]:
    """Every sample's shape, by as many threads as there are processors, and some more: most of it is waiting."""
    keys = [*s.training, *s.validation]
    parts = [keys[i : i + TOGETHER] for i in range(0, len(keys), TOGETHER)]
    with ThreadPoolExecutor(2 * cores()) as pool:
        try:
            for part in pool.map(lambda part: [(key, s.shape(key)) for key in part], parts):
                yield from part
        finally:
            pool.shutdown(cancel_futures=True)


def _compare(s: SampleSet, key: str, shape: Shape, usual: Shape, images: int, crop: int) -> None:
    n, h, w = shape
    if s.alike and shape != usual:
        raise InputError(
            f"sample {key} of {s.root} has {n} pictures of {h} x {w} pixels but others have {usual.pictures} of "
            f"{usual.rows} x {usual.columns}; restore it, or take it off the lists."
        )
    if n < images:
        raise InputError(
            f"sample {key} of {s.root} has {n} pictures but the recipe shows {images}; give a set with more, "
            "or take a recipe that shows fewer, such as normalnet-cpu."
        )
    if min(h, w) < crop:
        raise InputError(
            f"sample {key} of {s.root} has {h} x {w} pixels but the recipe's windows have {crop} x {crop}; "
            "give larger samples."
        )
