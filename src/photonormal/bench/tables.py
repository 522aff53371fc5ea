"""Tables from stored predictions: methods as rows, objects as columns, published figures beside ours."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from photonormal.bench.benchmarks import DILIGENT
from photonormal.bench.published import Published, of_method, others
from photonormal.bench.scores import Figures, Scored, all_scored
from photonormal.bench.store import configs
from photonormal.capture.pictures import natural
from photonormal.methods import METHODS
from photonormal.types import InputError

WIDE = 12  # objects above which a table shows means over them instead of one column each
PROTOCOLS = {"all": 0, "psfcn": 1, "draws": 2}  # order of tables


@dataclass(frozen=True)
class Column:
    """What a column holds.

    Parameters
    ----------
    name : under which rows have their cells
    kind : "object"; "sound", an object without its faulty pictures; "average" over the objects; "sound average", the
        same with sound ones in their places; "mean" over the objects, of a table without a column for each
    higher : more is better
    """

    name: str
    kind: Literal["object", "sound", "average", "sound average", "mean"]
    higher: bool = False

    @property
    def whole(self) -> bool:
        """Whether it sums up all objects."""
        return self.kind in ("average", "sound average", "mean")


AVERAGE = Column("average", "average")
MEAN = Column("mean_deg", "mean")
MEANS = (MEAN, Column("below_15", "mean", higher=True), Column("below_30", "mean", higher=True))  # the paper's Table 1


@dataclass(frozen=True)
class Cell:
    """A measured figure; over several draws their mean and standard deviation. `published` is what others print."""

    value: float
    spread: float | None = None
    published: float | None = None

    @property
    def difference(self) -> float | None:
        """Ours less theirs."""
        return None if self.published is None else self.value - self.published


@dataclass(frozen=True)
class Cost:
    """Median seconds for one object, largest memory over all of them, and on what."""

    read_s: float | None
    solve_s: float
    peak_memory_mb: float | None
    gpu_memory_mb: float | None
    machine: str


@dataclass(frozen=True)
class MethodRow:
    """One method.

    Parameters
    ----------
    over, draws : objects in its average, and draws of each
    sources : the published rows that its figures are set beside
    """

    label: str
    method: str
    cells: dict[str, Cell]
    over: int
    cost: Cost
    sources: tuple[Published, ...] = ()
    draws: int = 1


@dataclass(frozen=True)
class ErrorTable:
    """One dataset under one choice of images."""

    dataset: str
    protocol: str
    images: int
    versions: tuple[str, ...]
    columns: tuple[Column, ...]
    rows: tuple[MethodRow, ...]
    only_published: tuple[Published, ...] = field(default=())

    @property
    def title(self) -> str:
        images = f"{self.images} images" if self.images else "all images"
        how = {
            "all": images,
            "draws": f"{images}, {self.draws} random draws",
            "psfcn": f"{images}, the one draw of PS-FCN's code",
        }
        return f"{self.dataset}, {how.get(self.protocol, f'{images} ({self.protocol})')}"

    @property
    def over(self) -> int:
        """Objects in the average of the row that has most."""
        return max((row.over for row in self.rows), default=0)

    @property
    def draws(self) -> int:
        """Draws of the row that has most."""
        return max((row.draws for row in self.rows), default=0)

    def rank(self, column: Column) -> dict[str, int]:
        """label -> 1 for the best rows of a column and 2 for the second best, as printed with two places."""
        rows = [r for r in self.rows if column.name in r.cells and (not column.whole or r.over == self.over)]
        values = {r.label: round(r.cells[column.name].value, 2) for r in rows}
        steps = sorted(set(values.values()), reverse=column.higher)[:2]
        return {label: steps.index(v) + 1 for label, v in values.items() if v in steps} if len(values) > 1 else {}

    @property
    def measured(self) -> list[str]:
        """Objects in the average of the row that has most."""
        row = next((r for r in self.rows if r.over == self.over), None)
        return [c.name for c in self.columns if c.kind == "object" and row and c.name in row.cells]

    @property
    def summary(self) -> Column:
        """The column that sums it up."""
        return AVERAGE if AVERAGE in self.columns else MEAN


def tables(
    runs: str | Path, labels: Iterable[str] = (), datasets: Iterable[str] = (), published: bool = False
) -> list[ErrorTable]:
    """Every table that a folder of runs gives.

    Parameters
    ----------
    runs : the `out` of photonormal.bench.bench
    labels, datasets : only these; all by default
    published : add the rows of methods that were published but can't be run here

    Raises
    ------
    InputError
        If the folder holds no predictions, or some that this version can't read.
    """
    runs = Path(runs)
    known = configs(runs)
    groups: dict[tuple[str, str, int], list[Scored]] = {}
    for s in all_scored(runs, labels, datasets):
        p = s.prediction
        protocol = "all" if p.protocol == "sound" else p.protocol
        groups.setdefault((p.dataset, protocol, 0 if protocol == "all" else p.images), []).append(s)
    order = sorted(groups, key=lambda k: (k[0], PROTOCOLS.get(k[1], 9), -k[2], k[1]))
    found = [_table(key, groups[key], known, published) for key in order]
    if not found:
        raise InputError(f"{runs} holds no predictions of these; run photonormal bench with --out {runs} first.")
    return found


def _table(key: tuple[str, str, int], group: list[Scored], known: dict, published: bool) -> ErrorTable:
    dataset, protocol, images = key
    whole = [s for s in group if s.prediction.protocol != "sound"]
    counts = {s.prediction.images for s in whole}
    images = images or (counts.pop() if len(counts) == 1 else 0)
    names = sorted({s.prediction.object for s in whole}, key=natural)
    has_truth = any(s.score for s in group)
    if not has_truth:
        columns: tuple[Column, ...] = ()
    elif len(names) > WIDE:
        columns = MEANS
    else:
        objects = names
        if dataset == "diligent" and set(names) & set(DILIGENT):  # absent ones are blank
            objects = list(DILIGENT) + [n for n in names if n not in DILIGENT]
        sound: dict[str, list[Column]] = {}  # object -> its columns without faulty pictures
        for s in group:
            column = Column(_sound(s), "sound")
            if s.prediction.protocol == "sound" and column not in sound.setdefault(s.prediction.object, []):
                sound[s.prediction.object].append(column)  # bear, then bear76
        columns = (*(c for o in objects for c in (Column(o, "object"), *sound.get(o, []))), AVERAGE)
        if any(sound.values()):
            names_of_sound = (c.name for found in sound.values() for c in found)
            columns = (*columns, Column(f"average with {', '.join(names_of_sound)}", "sound average"))
    rows = []
    place = {method: i for i, method in enumerate(METHODS)}
    labels = {s.prediction.label for s in group}
    for label in sorted(labels, key=lambda m: (place.get(known[m, dataset]["method"], len(place)), m)):
        config = known[label, dataset]
        mine = [s for s in group if s.prediction.label == label]
        plain = config["options"] == _defaults(config["method"])
        sources = of_method(config["method"], dataset, images, protocol) if plain else ()
        rows.append(_row(label, config["method"], mine, columns, sources))
    return ErrorTable(
        dataset=dataset,
        protocol=protocol,
        images=images,
        versions=tuple(sorted({known[r.label, dataset]["photonormal"] for r in rows})),
        columns=columns,
        rows=tuple(rows),
        only_published=tuple(others(dataset, images)) if published and has_truth else (),
    )


def _row(
    label: str, method: str, mine: list[Scored], columns: Sequence[Column], sources: tuple[Published, ...]
) -> MethodRow:
    errors: dict[str, dict[str, float]] = {}  # column -> selection -> mean error
    for s in mine:
        if s.score is not None:
            column = _sound(s) if s.prediction.protocol == "sound" else s.prediction.object
            errors.setdefault(column, {})[s.prediction.record["selection"]] = s.score["mean_deg"]
    instead = {s.prediction.object: _sound(s) for s in mine if s.prediction.protocol == "sound"}
    objects = [c for c in errors if c not in instead.values()]
    measured: dict[str, list[float]] = {}  # column -> a figure for each draw
    if AVERAGE in columns and objects:
        measured = {column: list(found.values()) for column, found in errors.items()}
        common = set.intersection(*(set(errors[o]) for o in objects))  # draws that all objects have
        means = [statistics.fmean(errors[o][d] for o in objects) for d in sorted(common)]
        measured[AVERAGE.name] = means or [statistics.fmean(statistics.fmean(errors[o].values()) for o in objects)]
        if instead:
            with_sound = statistics.fmean(statistics.fmean(measured[instead.get(o, o)]) for o in objects)
            measured |= {c.name: [with_sound] for c in columns if c.kind == "sound average"}
    elif columns and objects:
        figures: dict[str, list[Figures]] = {}  # of each object
        for s in mine:
            if s.score is not None and s.prediction.protocol != "sound":
                figures.setdefault(s.prediction.object, []).append(s.score)
        measured = {
            c.name: [statistics.fmean(statistics.fmean(f[c.name] for f in draws) for draws in figures.values())]
            for c in columns
        }
    theirs = {c: next((p for p in sources if p.value(c, objects) is not None), None) for c in measured}
    cells = {}
    for column, values in measured.items():
        p = theirs[column]
        spread = statistics.stdev(values) if len(values) > 1 else None
        cells[column] = Cell(statistics.fmean(values), spread, p and p.value(column, objects))
    used = tuple(p for p in sources if p in theirs.values())
    draws = {s.prediction.record["selection"] for s in mine if s.prediction.protocol != "sound"}
    return MethodRow(label, method, cells, len(objects), _cost(mine), used, len(draws))


def _cost(mine: list[Scored]) -> Cost:
    records = [s.prediction.record for s in mine]
    read = [r["seconds"]["read"] for r in records if "read" in r["seconds"]]
    memory = [r["peak_memory_mb"] for r in records if r["peak_memory_mb"] is not None]
    gpu = [r["gpu_memory_mb"] for r in records if r["gpu_memory_mb"] is not None]
    machines = dict.fromkeys(
        f"{r['device']}, {r['processor']}, {r['cores']} cores" + (f", {r['jobs']} jobs" if r["jobs"] > 1 else "")
        for r in records
    )
    return Cost(
        read_s=statistics.median(read) if read else None,
        solve_s=statistics.median(r["seconds"]["solve"] for r in records),
        peak_memory_mb=max(memory, default=None),
        gpu_memory_mb=max(gpu, default=None),
        machine="; ".join(machines),
    )


def _sound(s: Scored) -> str:
    """Column of an object without its faulty pictures: bear76."""
    return f"{s.prediction.object}{s.prediction.images}"


def _defaults(method: str) -> dict | None:
    """A method's own options as a config holds them; None where this version does not have the method."""
    from photonormal.bench.contest import Entry

    if method not in METHODS:
        return None
    return Entry(method, method, {}).options_as_stored()
