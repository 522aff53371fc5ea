"""Figures from stored predictions and from training logs, each as PNG and PDF, in colours for the colour-blind."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from photonormal.lookup import lookup
from photonormal.types import InputError, by_name

FIGURES = {  # name -> "module:function"; a function takes a Wish and gives a matplotlib figure
    "errors": "photonormal.bench.figures.maps:errors",
    "normals": "photonormal.bench.figures.maps:normals",
    "images": "photonormal.bench.figures.curves:images",
    "seconds": "photonormal.bench.figures.curves:seconds",
    "materials": "photonormal.bench.figures.materials:materials",
    "convergence": "photonormal.bench.figures.convergence:convergence",
}
DPI = 200
ENDINGS = ("png", "pdf")


@dataclass(frozen=True)
class Wish:
    """What a figure shows.

    Parameters
    ----------
    places : the folder of runs; for "convergence" folders of trainings, ``label=folder`` or ``folder``
    dataset : "": the only one, or diligent
    methods, objects : only these, in this order; empty: as the figure chooses
    limit_deg : error of the last colour; None: chosen from the errors shown
    """

    places: tuple[str, ...]
    dataset: str = ""
    methods: tuple[str, ...] = ()
    objects: tuple[str, ...] = ()
    limit_deg: float | None = None

    @property
    def runs(self) -> Path:
        """The one folder of runs."""
        if len(self.places) != 1:
            raise InputError(f"{len(self.places)} folders came but one folder of runs is needed; give that alone.")
        return Path(self.places[0])

    @property
    def labelled(self) -> list[tuple[str, Path]]:
        """The folders with their labels, "" where none was given: what exists as it is written has none."""
        parted = [("", "", place) if Path(place).exists() else place.rpartition("=") for place in self.places]
        return [(label, Path(folder)) for label, _, folder in parted]


def figure(
    name: str,
    places: Sequence[str | Path],
    out: str | Path | None = None,
    dataset: str = "",
    methods: Sequence[str] = (),
    objects: Sequence[str] = (),
    limit_deg: float | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Draw one figure and write it as PNG and PDF.

    Parameters
    ----------
    name : a key of FIGURES
    places, dataset, methods, objects, limit_deg : see Wish
    out : folder to write into; None: `figures` in the folder of runs, where a figure replaces the one before
    overwrite : replace files in `out`

    Returns
    -------
    The two files.

    Raises
    ------
    InputError
        If the figure does not exist or what it shows is not there.
    """
    place = by_name("figure", name, FIGURES)
    if not places:
        raise InputError("no folder came; give the folder of runs, or for convergence those of trainings.")
    from photonormal.bench.figures.style import STYLE, style_context
    from photonormal.disk import at_once, refuse_taken

    wish = Wish(tuple(str(p) for p in places), dataset, tuple(methods), tuple(objects), limit_deg)
    folder = Path(out) if out is not None else wish.labelled[0][1] / "figures"
    refuse_taken([folder / f"{name}.{ending}" for ending in ENDINGS], overwrite or out is None)
    with style_context(STYLE):
        drawn = draw(lookup(place), wish)
        files = {}
        for ending in ENDINGS:
            buffer = io.BytesIO()
            drawn.savefig(buffer, format=ending, dpi=DPI, bbox_inches="tight", pad_inches=0.03)
            files[f"{name}.{ending}"] = buffer.getvalue()
    with at_once(folder) as batch:
        for file, data in files.items():
            batch.write(file, data)
    return [folder / file for file in files]


def draw(function: Callable[[Wish], Any], wish: Wish) -> Any:
    """The figure of a function, for tests to look into."""
    return function(wish)
