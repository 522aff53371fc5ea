"""What the report shows of each object, as pictures and numbers that a page can hold."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from photonormal.bench.scores import Scored
from photonormal.bench.store import Truth, read_truth, truth_path
from photonormal.integrate import integrate
from photonormal.score import error_map_deg
from photonormal.types import Normals
from photonormal.view.planes import LEVELS_PER_DEGREE, UNKNOWN, evenly

SIDE = 512  # pixels; larger pictures are reduced to it
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
    rows, columns = (np.flatnonzero(truth.mask.any(axis)) for axis in (1, 0))
    box = np.s_[
        max(0, rows[0] - MARGIN) : rows[-1] + 1 + MARGIN, max(0, columns[0] - MARGIN) : columns[-1] + 1 + MARGIN
    ]
    ranked = sorted(found, key=lambda s: s.score["mean_deg"] if s.score else 0.0)
    methods = {}
    for s in ranked:
        map = s.prediction.normals()
        methods[s.prediction.label] = {
            "normals": _picture(_coloured(map)[box], ".webp"),
            "error": None
            if truth.normals is None
            else _picture(_levels(error_map_deg(map, truth.normals))[box], ".png"),
            "score": s.score,
        }
    best = ranked[0].prediction
    h, w = _reduced(truth.mask[box]).shape
    return {
        "dataset": dataset,
        "name": name,
        "width": w,
        "height": h,
        "photograph": _picture(truth.photograph[box], ".webp"),
        "truth": None if truth.normals is None else _picture(_coloured(truth.normals)[box], ".webp"),
        "methods": methods,
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


def _coloured(normals: Normals) -> np.ndarray:
    picture = np.rint(127.5 * (normals.map + 1)).astype(np.uint8)
    picture[~normals.mask] = 255
    return picture


def _levels(error: np.ndarray) -> np.ndarray:
    level = np.rint(LEVELS_PER_DEGREE * np.nan_to_num(error)).clip(0, UNKNOWN - 1)
    return np.where(np.isnan(error), UNKNOWN, level).astype(np.uint8)


def _reduced(picture: np.ndarray) -> np.ndarray:
    step = int(np.ceil(max(picture.shape[:2]) / SIDE))
    return picture[::step, ::step]


def _picture(picture: np.ndarray, ending: str) -> str:
    """A data address. Error levels are kept exactly, other pictures nearly."""
    import cv2

    picture = _reduced(picture)
    bgr = np.ascontiguousarray(picture[..., ::-1] if picture.ndim == 3 else picture)
    quality = [cv2.IMWRITE_WEBP_QUALITY, 88] if ending == ".webp" else []
    data = base64.b64encode(cv2.imencode(ending, bgr, quality)[1].tobytes()).decode()
    return f"data:image/{ending[1:]};base64,{data}"
