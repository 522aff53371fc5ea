"""Training and validation error against the step, for several trainings (the paper's Figure 5)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from msgspec import Meta

from photonormal.bench.figures import Wish
from photonormal.bench.figures.style import COLOURS, LINES, MARKERS, Figure
from photonormal.options import Whole
from photonormal.stored import LONGEST, Word, converted, decoded, stored_bytes
from photonormal.types import InputError

JOURNAL = "journal.jsonl"  # what photonormal.train writes
ADVICE = "give a folder of training"
Degrees = Annotated[float, Meta(ge=0, le=180)]


class JournalLine(TypedDict):
    """What every line of a journal has, besides figures by name."""

    step: Whole
    kind: Word


PANELS = {  # kind of entry -> its figure and the panel's title; those that a journal has are drawn
    "train": ("loss_angle_deg", "training crops"),
    "clean": ("mean_deg", "validation, held-out materials"),
    "hemisphere": ("mean_deg", "validation, lights from everywhere"),
    "real": ("mean", "real objects"),
}


def convergence(wish: Wish) -> Figure:
    """One line for each training, one panel for each kind of error."""
    journals = {}
    for label, path in wish.labelled:
        label = label or path.resolve().name
        if label in journals:
            raise InputError(f"two trainings are called {label!r}; name them apart: LABEL={path}.")
        journals[label] = read_journal(path)
    kinds = [k for k in PANELS if any(k in j for j in journals.values())]
    if not kinds:
        raise InputError(f"{', '.join(wish.places)} hold no entries yet; train for longer.")
    figure = Figure(figsize=(2.6 * len(kinds) + 0.4, 2.4), layout="constrained")
    axes = figure.subplots(1, len(kinds), squeeze=False)[0]
    for a, kind in zip(axes, kinds, strict=True):
        for i, (label, journal) in enumerate(journals.items()):
            steps, values = zip(*journal[kind], strict=True) if kind in journal else ((), ())
            a.plot(
                steps,
                values,
                color=COLOURS[i % len(COLOURS)],
                linestyle=LINES[i // len(COLOURS) % len(LINES)],
                marker=MARKERS[i % len(MARKERS)] if len(steps) < 30 else None,
                markersize=3,
                linewidth=1.1,
                label=label,
            )
        a.set_title(PANELS[kind][1])
        a.set_xlabel("step")
        a.grid(linewidth=0.3)
    axes[0].set_ylabel("mean angular error, degrees")
    axes[0].legend()
    return figure


def read_journal(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """kind -> (step, error in degrees) of a training's journal; of a step written twice, the later."""
    path = folder / JOURNAL if folder.is_dir() else folder
    found: dict[str, dict[int, float]] = {}
    for i, line in enumerate(stored_bytes(path, ADVICE, LONGEST).splitlines()):
        if line.strip():
            what = f"{path}, line {i + 1}"
            entry = decoded(line, JournalLine, what, ADVICE)
            name = PANELS.get(entry["kind"], ("", ""))[0]
            value = decoded(line, dict[str, float | Word | None], what, ADVICE).get(name)
            if value is not None:  # null where it was no number
                degrees = converted(value, Degrees, what, ADVICE)  # pyright: ignore[reportArgumentType]
                found.setdefault(entry["kind"], {})[entry["step"]] = degrees
    return {kind: sorted(entries.items()) for kind, entries in found.items()}
