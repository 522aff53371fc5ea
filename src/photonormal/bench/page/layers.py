"""What the report shows of each object, as pictures and numbers that a page can hold."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from photonormal.bench.scores import Scored
from photonormal.bench.store import Truth, read_truth, truth_path
from photonormal.capture.pictures import evenly
from photonormal.integration import integrate
from photonormal.masked import box_of
from photonormal.scoring import error_map_deg
from photonormal.types import Normals
from photonormal.view.planes import SIDE, degrees_plane, normals_plane, plane

SURFACE_SIDE = 256
MARGIN = 3


def objects(
    runs: Path, whole: list[Scored], shown: Sequence[str], limit: int, surfaces: bool, advance: Callable[[], None]
) -> Iterator[dict[str, Any]]:
    """Every object to show: its photograph, truth and each method's normals and errors."""
    groups: dict[str, dict[str, list[Scored]]] = {}  # dataset -> object -> predictions
    for s in whole:
        groups.setdefault(s.prediction.dataset, {}).setdefault(s.prediction.object, []).append(s)
    for dataset, by_object in groups.items():
        names = [n for n in by_object if n in shown] if shown else evenly(list(by_object), limit)
        for name in names:
            truth = read_truth(truth_path(runs, dataset, name))
            yield _object(dataset, name, truth, by_object[name], surfaces)
            advance()


def _object(dataset: str, name: str, truth: Truth, found: list[Scored], surfaces: bool) -> dict[str, Any]:
    box = box_of(truth.mask, MARGIN)
    ranked = sorted(found, key=lambda s: s.score["mean_deg"] if s.score else 0.0)
    photograph = _reduced(truth.photograph[box])
    planes = {"photograph": plane("colour", photograph)}
    if truth.normals is not None:
        planes["truth"] = normals_plane(_reduced(truth.normals.map[box]))
    for s in ranked:
        normals = s.prediction.normals()
        planes[f"normals:{s.prediction.label}"] = normals_plane(_reduced(normals.map[box]))
        if truth.normals is not None:
            error = error_map_deg(normals, truth.normals)
            planes[f"error:{s.prediction.label}"] = degrees_plane(_reduced(error[box]))
    best = ranked[0].prediction
    h, w = photograph.shape[:2]
    return {
        "dataset": dataset,
        "name": name,
        "width": w,
        "height": h,
        "layers": {key: p.kind for key, p in planes.items()},
        "tiles": {key: base64.b64encode(p.tile(0, 0, 0)).decode() for key, p in planes.items()},
        "scores": {s.prediction.label: s.score for s in ranked},
        "surface": _surface(best.normals(), box) | {"method": best.label} if surfaces else None,
    }


def _surface(normals: Normals, box: tuple[slice, slice]) -> dict[str, Any]:
    """Heights in pixels on a coarser grid, 16 bits each, 0 outside."""
    surface = integrate(normals)
    depth = surface.depth[box]
    step = max(1, int(np.ceil(max(depth.shape) / SURFACE_SIDE)))
    depth = depth[::step, ::step] / step
    known = np.isfinite(depth)
    low, high = np.quantile(depth[known], (0.002, 0.998))
    level = np.zeros(depth.shape, "<u2")
    level[known] = np.rint(1 + 65534 * ((depth[known] - low) / max(high - low, 1e-6)).clip(0, 1))
    return {
        "width": depth.shape[1],
        "height": depth.shape[0],
        "range": float(high - low),
        "levels": base64.b64encode(level.tobytes()).decode(),
    }


def _reduced(picture: np.ndarray) -> np.ndarray:
    """Every so many of its pixels, so that it is one tile."""
    step = int(np.ceil(max(picture.shape[:2]) / SIDE))
    return picture[::step, ::step]
