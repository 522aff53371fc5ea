"""Figures of maps: errors in colours (the paper's Figures 4, 6 and 8), normals and surfaces (Figures 1 and 7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from photonormal.bench.figures import Wish
from photonormal.bench.figures.relief import relief
from photonormal.bench.figures.style import ERRORS, Figure
from photonormal.bench.scores import Scored, all_scored
from photonormal.bench.store import Truth, configs, read_truth, truth_path
from photonormal.integration import integrate
from photonormal.masked import box_of
from photonormal.scoring import error_map_deg
from photonormal.types import InputError, Normals

OBJECTS, METHODS = 4, 5  # at most in one figure, unless they are named
INCH = 1.25  # a panel's side
MARGIN = 3  # pixels around the object


@dataclass(frozen=True)
class FigureObject:
    """One object of a figure: its truth and its predictions from all images, by method."""

    name: str
    truth: Truth
    found: dict[str, Scored]

    @property
    def box(self) -> tuple[slice, slice]:
        return box_of(self.truth.mask, MARGIN)


def errors(wish: Wish) -> Figure:
    """Photograph and true normals, then each method's normals above its error map, all under one colour bar."""
    shown, labels = chosen(wish)
    maps = {
        (s.name, label): error_map_deg(s.found[label].prediction.normals(), s.truth.normals)[s.box]
        for s in shown
        for label in labels
        if label in s.found and s.truth.normals is not None
    }
    if not maps:
        raise InputError(f"{wish.runs} holds no true normals of these objects; draw the figure normals instead.")
    every = np.concatenate([m[np.isfinite(m)] for m in maps.values()])
    limit = wish.limit_deg or max(5.0, 5 * np.ceil(float(np.quantile(every, 0.9)) / 5))
    figure, axes = _panels(2 * len(shown), len(labels) + 1)
    image: Any = None
    for i, s in enumerate(shown):
        top, bottom = axes[2 * i], axes[2 * i + 1]
        top[0].imshow(s.truth.photograph[s.box])
        if s.truth.normals is not None:
            bottom[0].imshow(normals_picture(s.truth.normals)[s.box])
        top[0].set_ylabel(s.name)
        bottom[0].set_ylabel("truth")
        for j, label in enumerate(labels, 1):
            if (s.name, label) in maps:
                top[j].imshow(normals_picture(s.found[label].prediction.normals())[s.box])
                image = bottom[j].imshow(maps[s.name, label], cmap=ERRORS, vmin=0, vmax=limit)
                score = s.found[label].score
                bottom[j].set_xlabel(f"{score['mean_deg']:.2f}°" if score else "")
            if i == 0:
                top[j].set_title(label)
    bar = figure.colorbar(image, ax=axes.ravel().tolist(), fraction=0.02, pad=0.01, extend="max", aspect=40)
    bar.set_label("angular error, degrees")
    return figure


def normals(wish: Wish) -> Figure:
    """Photograph, then each method's normals and the surface integrated from them, seen from the side."""
    shown, labels = chosen(wish, count=2)
    figure, axes = _panels(len(shown), 1 + 2 * len(labels))
    for i, s in enumerate(shown):
        axes[i][0].imshow(s.truth.photograph[s.box])
        axes[i][0].set_ylabel(s.name)
        for j, label in enumerate(labels):
            if label in s.found:
                map = s.found[label].prediction.normals()
                axes[i][1 + 2 * j].imshow(normals_picture(map)[s.box])
                axes[i][2 + 2 * j].imshow(relief(integrate(map), map))
                score = s.found[label].score
                axes[i][1 + 2 * j].set_xlabel(f"{score['mean_deg']:.2f}°" if score else "")
            if i == 0:
                axes[i][1 + 2 * j].set_title(label)
                axes[i][2 + 2 * j].set_title("surface")
    return figure


def normals_picture(normals: Normals) -> np.ndarray:
    """(n + 1) / 2 as 8-bit colours, white outside."""
    picture = np.rint(127.5 * (normals.map + 1)).astype(np.uint8)
    picture[~normals.mask] = 255
    return picture


def chosen(wish: Wish, count: int = METHODS) -> tuple[list[FigureObject], list[str]]:
    """Objects and methods to show: those named, else the first objects and the methods of least error."""
    dataset = dataset_of(wish)
    found = [s for s in all_scored(wish.runs, wish.methods, [dataset]) if s.prediction.protocol == "all"]
    names = list(dict.fromkeys(s.prediction.object for s in found))
    for name in wish.objects:
        if name not in names:
            raise InputError(f"{wish.runs} holds no object {name!r} of {dataset}; it has {', '.join(names[:20])}.")
    names = list(wish.objects) or names[:OBJECTS]
    labels = list(wish.methods) or _best(found, names)[:count]
    if not names or not labels:
        raise InputError(f"{wish.runs} holds no predictions of {dataset} from all images; run photonormal bench.")
    shown = []
    for name in names:
        mine = {s.prediction.label: s for s in found if s.prediction.object == name}
        shown.append(FigureObject(name, read_truth(truth_path(wish.runs, dataset, name)), mine))
    return shown, labels


def dataset_of(wish: Wish, usual: str = "diligent") -> str:
    """The dataset named, else the only one, else the only one whose name starts with the usual one's."""
    known = list(dict.fromkeys(dataset for _, dataset in configs(wish.runs)))
    found = [wish.dataset] if wish.dataset else known if len(known) == 1 else [k for k in known if k.startswith(usual)]
    if len(found) != 1:
        raise InputError(f"{wish.runs} holds {', '.join(known)}; choose one with --dataset.")
    return found[0]


def _best(found: list[Scored], names: list[str]) -> list[str]:
    """Methods by their mean error over the objects shown."""
    errors: dict[str, list[float]] = {}
    for s in found:
        if s.prediction.object in names:
            errors.setdefault(s.prediction.label, []).append(s.score["mean_deg"] if s.score else 0.0)
    return sorted(errors, key=lambda label: float(np.mean(errors[label])))


def _panels(rows: int, columns: int) -> tuple[Figure, Any]:
    figure = Figure(figsize=(INCH * columns + 0.6, INCH * rows + 0.3), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for a in axes.ravel():
        a.set_xticks([])
        a.set_yticks([])
        for side in a.spines.values():
            side.set_visible(False)
    return figure, axes
