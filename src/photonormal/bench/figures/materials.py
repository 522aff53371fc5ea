"""Error on every material, a bar chart for each method (the paper's Figure 3)."""

from __future__ import annotations

import numpy as np

from photonormal.bench.figures import Wish
from photonormal.bench.figures.maps import dataset_of
from photonormal.bench.figures.style import COLOURS, Figure
from photonormal.bench.scores import all_scored
from photonormal.types import InputError

FIRST = "woodham"  # the method whose errors order the materials, where it is there


def materials(wish: Wish) -> Figure:
    """One panel for each method, materials in one order: by the error of least squares."""
    errors: dict[str, dict[str, float]] = {}
    for s in all_scored(wish.runs, wish.methods, [dataset_of(wish, "materials")]):
        if s.prediction.protocol == "all" and s.score is not None:
            errors.setdefault(s.prediction.label, {})[s.prediction.object] = s.score["mean_deg"]
    if not errors:
        raise InputError(f"{wish.runs} holds no errors from all images; run photonormal bench materials.")
    common = set.intersection(*(set(e) for e in errors.values()))
    if wish.objects:
        common &= set(wish.objects)
    if not common:
        raise InputError(f"the methods of {wish.runs} share no object; run all of them on the same ones.")
    labels = list(wish.methods) or sorted(errors, key=lambda m: -np.mean([errors[m][o] for o in common]))
    first = errors.get(FIRST, errors[labels[0]])
    names = sorted(common, key=lambda o: first[o])
    figure = Figure(figsize=(max(4.0, 0.11 * len(names) + 1), 1.15 * len(labels) + 1.2), layout="constrained")
    axes = figure.subplots(len(labels), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    x = np.arange(len(names))
    for i, (a, label) in enumerate(zip(axes, labels, strict=True)):
        y = np.array([errors[label][o] for o in names])
        a.bar(x, y, width=0.8, color=COLOURS[i % len(COLOURS)])
        a.axhline(y.mean(), color="black", linewidth=0.7, linestyle="--")
        a.set_title(f"{label}: mean {y.mean():.2f}°, worst {y.max():.2f}°", loc="left", pad=2)
        a.grid(axis="y", linewidth=0.3)
        a.set_axisbelow(True)
    axes[-1].set_xticks(x, names, rotation=90, fontsize=5.5)
    axes[-1].set_xlim(-0.6, len(names) - 0.4)
    figure.supylabel("mean angular error, degrees", fontsize=8)
    return figure
