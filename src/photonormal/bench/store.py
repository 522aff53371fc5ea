"""Predictions on disk: what `bench` writes and everything else reads.

runs/
    <method>/<dataset>/
        config.json                     method, options, digests of weights and code, version: what all depends on
        <object>.npz, <object>.json     normals and mask, as `photonormal.load_normals` reads; what was measured
        <object>@<selection>.npz        the same from some of the images
        scores.json                     errors found so far, kept so that a table need not find them again
    truth/<dataset>/<object>.npz        true normals, mask, and one photograph
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import numpy as np

from photonormal.disk import PARTIAL, at_once, recover
from photonormal.export.folder import as_json
from photonormal.files.opening import read_npz
from photonormal.options import Count, NotNegative, Precision
from photonormal.provenance import change
from photonormal.stored import Name, Word, read_json
from photonormal.types import InputError, Normals

LAYOUT = 1  # of the folder; another number can't be read
CONFIG = "config.json"
SCORES = "scores.json"
AGAIN = "remove it and run the benchmark again"


class Seconds(TypedDict):
    """Of one prediction; reading is measured with all images only."""

    solve: NotNegative
    read: NotRequired[NotNegative]


class Record(TypedDict):
    """How a prediction was made."""

    object: Name
    selection: Word
    protocol: Word
    images: list[Word]
    seconds: Seconds
    peak_memory_mb: NotNegative | None
    gpu_memory_mb: NotNegative | None
    device: Word
    processor: Word
    cores: Count
    jobs: Count


Option = bool | int | float | Word | None
Options = dict[str, Option | list[Option] | dict[str, Any]]  # methods hold other methods


class Config(TypedDict):
    """What the predictions of a folder depend on."""

    layout: int
    photonormal: Word
    method: Word
    options: Options
    weights_sha256: NotRequired[Word | None]
    source_sha256: NotRequired[Word]
    precision: NotRequired[Precision]
    srgb: NotRequired[bool]


class Layout(TypedDict):
    """What every version's config has."""

    layout: int
    photonormal: Word


@dataclass(frozen=True)
class Prediction:
    """One stored normal map, with the record of how it was made."""

    label: str
    dataset: str
    path: Path
    record: Record

    @property
    def object(self) -> str:
        return self.record["object"]

    @property
    def protocol(self) -> str:
        return self.record["protocol"]

    @property
    def images(self) -> int:
        return len(self.record["images"])

    def normals(self) -> Normals:
        """The normal map."""
        return _read_npz(self.path)[0]


@dataclass(frozen=True)
class Truth:
    """What an object's predictions are compared with: its photograph, its mask, and its true normals if known."""

    normals: Normals | None
    mask: np.ndarray  # (h, w) bool
    photograph: np.ndarray  # (h, w, 3) 8-bit sRGB


def prediction_path(out: Path, label: str, dataset: str, name: str, selection: str = "") -> Path:
    """Where a prediction lies."""
    own = f"{name}.json" in (CONFIG, SCORES)  # an object's record would be called as ours are
    return out / label / dataset / (f"{name}@{selection}.npz" if selection or own else f"{name}.npz")


def truth_path(out: Path, dataset: str, name: str) -> Path:
    """Where an object's truth lies."""
    return out / "truth" / dataset / f"{name}.npz"


def record_path(prediction: Path) -> Path:
    """The record beside a prediction."""
    return prediction.with_suffix(".json")


def write_prediction(path: Path, normals: Normals, record: dict[str, Any], half: bool) -> None:
    """Store normals and their record, at once.

    `half`: in half precision, which moves a normal by 0.02 degrees at most; for the many draws.
    """
    map = normals.map.astype(np.float16) if half else normals.map
    with at_once(path.parent) as batch:
        batch.write(record_path(path).name, as_json(record))
        batch.write(path.name, _npz(normals=map, mask=normals.mask))


def write_truth(path: Path, truth: Truth) -> None:
    """Store what an object's predictions are compared with."""
    known = {} if truth.normals is None else {"normals": truth.normals.map, "mask": truth.normals.mask}
    with at_once(path.parent) as batch:
        batch.write(path.name, _npz(object=truth.mask, photograph=truth.photograph, **known))


def read_truth(path: Path) -> Truth:
    """The truth beside the predictions; InputError where there is none."""
    normals, data = _read_npz(path, optional=True)
    mask, photograph = (data.get(name, np.zeros(0)) for name in ("object", "photograph"))
    if mask.dtype != bool or mask.ndim != 2 or not mask.any() or photograph.dtype != np.uint8:
        raise InputError(f"{path} can't be read (it holds no mask or no photograph); {AGAIN}.")
    if photograph.shape != (*mask.shape, 3) or (normals is not None and normals.mask.shape != mask.shape):
        raise InputError(f"{path} can't be read (its pictures have several sizes); {AGAIN}.")
    return Truth(normals, mask, photograph)


def check_config(folder: Path, config: Mapping[str, Any]) -> None:
    """Write a folder's config, or InputError where it holds predictions that were made in another way."""
    config = {"layout": LAYOUT, **config}
    path = folder / CONFIG
    if not path.is_file():
        with at_once(folder) as batch:
            if others := sorted(p.name for p in folder.iterdir() if p.name != PARTIAL):
                raise InputError(f"{folder} holds {others[0]} but no predictions of photonormal; choose another --out.")
            batch.write(CONFIG, as_json(config))
        return
    if found := change(read_config(path), config):
        raise InputError(f"{folder} was made with {found[1]}; choose another --out or remove that folder.")


def read_config(path: Path) -> Config:
    """A folder's config; InputError where it is damaged or of a layout that this version can't read."""
    made = read_json(path, Layout, AGAIN)
    if made["layout"] != LAYOUT:
        raise InputError(
            f"{path.parent} has layout {made['layout']} of photonormal {made['photonormal']} but this "
            f"version reads layout {LAYOUT}; run the benchmark again into another folder."
        )
    return read_json(path, Config, AGAIN)


def configs(runs: Path) -> dict[tuple[str, str], Config]:
    """(label, dataset) -> config of every folder of predictions."""
    if not runs.is_dir():
        raise InputError(f"{runs} is no folder; give the --out of photonormal bench.")
    for left in sorted(runs.glob(f"*/*/{PARTIAL}")):
        recover(left.parent)
    found = {(p.parts[-3], p.parts[-2]): read_config(p) for p in sorted(runs.glob(f"*/*/{CONFIG}"))}
    if not found:
        result = (runs / "normals.npz").is_file()
        todo = (
            f"look at this result with `photonormal view {runs}`"
            if result
            else f"run photonormal bench with --out {runs} first"
        )
        raise InputError(f"{runs} holds no predictions; {todo}.")
    return found


def predictions(runs: Path, label: str, dataset: str) -> Iterator[Prediction]:
    """Every stored prediction of a method on a dataset, in the order of names."""
    folder = runs / label / dataset
    for path in sorted(folder.rglob("*.npz")):
        if not any(part.startswith(".") for part in path.relative_to(folder).parts):
            yield Prediction(label, dataset, path, read_json(record_path(path), Record, AGAIN))


def _npz(**arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _read_npz(path: Path, optional: bool = False) -> tuple[Any, dict[str, np.ndarray]]:
    data = read_npz(path, AGAIN)
    if optional and "normals" not in data:
        return None, data
    if not {"normals", "mask"} <= set(data):
        raise InputError(f"{path} can't be read (it holds no normals or no mask); {AGAIN}.")
    try:
        return Normals(data["normals"].astype(np.float32), data["mask"]), data
    except InputError as error:
        raise InputError(f"{path} can't be read ({error}); {AGAIN}.") from None
