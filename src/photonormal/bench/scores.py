"""Errors of stored predictions against the stored truth; found once, then kept beside the predictions."""

from __future__ import annotations

import json
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from photonormal.bench.store import SCORES, Prediction, configs, predictions, read_truth, truth_path
from photonormal.disk import write
from photonormal.score import score
from photonormal.types import InputError, cores


@dataclass(frozen=True)
class Scored:
    """A prediction with its errors; None where the truth is not known."""

    prediction: Prediction
    score: dict[str, float | int] | None


def scored(runs: Path, label: str, dataset: str) -> list[Scored]:
    """Every prediction of a method on a dataset with its errors."""
    folder = runs / label / dataset
    before = _kept(folder / SCORES)
    read = cache(lambda name: read_truth(truth_path(runs, dataset, name)))
    found = {}

    def one(p: Prediction) -> Scored:
        stamp = [_stamp(p.path), _stamp(truth_path(runs, dataset, p.object))]
        key = str(p.path.relative_to(folder))
        if before.get(key, {}).get("stamp") == stamp:
            found[key] = before[key]
        else:
            truth = read(p.object).normals
            found[key] = {"stamp": stamp, "score": truth and score(p.normals(), truth).as_dict()}
        return Scored(p, found[key]["score"])

    with ThreadPoolExecutor(cores()) as pool:
        results = list(pool.map(one, predictions(runs, label, dataset)))
    if found != before:
        write(folder / SCORES, json.dumps(found).encode())
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
    except FileNotFoundError:
        raise InputError(f"{path} is missing but errors are found with it; run the benchmark again.") from None
    return [status.st_mtime_ns, status.st_size]


def _kept(path: Path) -> dict[str, dict]:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
