"""Errors of stored predictions against the stored truth; found once, then kept beside the predictions."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypedDict

import msgspec

from photonormal.bench.store import AGAIN, SCORES, Prediction, configs, predictions, read_truth, truth_path
from photonormal.disk import write
from photonormal.options import Count, NotNegative
from photonormal.resources import cores, in_threads
from photonormal.scoring import score
from photonormal.stored import read_json
from photonormal.types import InputError


class Figures(TypedDict):
    """The numbers of a `photonormal.scoring.Score`."""

    mean_deg: NotNegative
    median_deg: NotNegative
    below_15: NotNegative
    below_30: NotNegative
    pixels: Count


class Kept(TypedDict):
    """Errors found before, and the times and sizes of the files that they were found from."""

    stamp: list[list[int]]
    score: Figures | None


@dataclass(frozen=True)
class Scored:
    """A prediction with its errors; None where the truth is not known."""

    prediction: Prediction
    score: Figures | None


def scored(runs: Path, label: str, dataset: str) -> list[Scored]:
    """Every prediction of a method on a dataset with its errors."""
    folder = runs / label / dataset
    before: dict[str, Kept] = {}
    with suppress(InputError):  # what is not there, or damaged, is found again
        before = read_json(folder / SCORES, dict[str, Kept], AGAIN)
    read = cache(lambda name: read_truth(truth_path(runs, dataset, name)))
    found = {}

    def one(p: Prediction) -> Scored:
        stamp = [_stamp(p.path), _stamp(truth_path(runs, dataset, p.object))]
        key = str(p.path.relative_to(folder))
        if key in before and before[key]["stamp"] == stamp:
            found[key] = before[key]
        else:
            truth = read(p.object).normals
            found[key] = {"stamp": stamp, "score": truth and score(p.normals(), truth).as_dict()}
        return Scored(p, found[key]["score"])

    results = in_threads(one, predictions(runs, label, dataset), cores())
    if found != before:
        with suppress(InputError):  # a folder that can't be written is read all the same
            write(folder / SCORES, msgspec.json.encode(found))
    return results


def all_scored(runs: Path, labels: Iterable[str] = (), datasets: Iterable[str] = ()) -> list[Scored]:
    """Every prediction in a folder of runs; of some methods or datasets only, if named."""
    known = configs(runs)
    for wanted, place, what in ((set(labels), 0, "method"), (set(datasets), 1, "dataset")):
        if unknown := sorted(wanted - {k[place] for k in known}):
            have = ", ".join(dict.fromkeys(k[place] for k in known))
            raise InputError(f"{runs} holds no {what} {unknown[0]!r}; it has {have}.")
    chosen = [k for k in known if (not labels or k[0] in labels) and (not datasets or k[1] in datasets)]
    return [s for label, dataset in chosen for s in scored(runs, label, dataset)]


def _stamp(path: Path) -> list[int]:
    try:
        status = path.stat()
    except OSError as error:
        why = "is missing" if isinstance(error, FileNotFoundError) else f"can't be read ({error.strerror})"
        raise InputError(f"{path} {why} but errors are found with it; run the benchmark again.") from None
    return [status.st_mtime_ns, status.st_size]
