"""Mean error against the number of images, and against seconds."""

from __future__ import annotations

from typing import Any

from photonormal.bench.figures import Wish
from photonormal.bench.figures.maps import dataset_of
from photonormal.bench.figures.style import COLOURS, LINES, MARKERS, Figure
from photonormal.bench.tables import ErrorTable, tables
from photonormal.types import InputError

MARK = 6  # points, of a method's mark
PLACES = tuple(  # of a name beside its mark: distance in points, and direction
    (far, dx, dy)
    for far in (5, 12, 20, 30, 42)
    for dx, dy in ((1, 0), (1, 1), (1, -1), (-1, 0), (-1, 1), (-1, -1), (0, 1), (0, -1))
)


def images(wish: Wish) -> Figure:
    """One line for each method; the band is the standard deviation over random draws."""
    points: dict[str, list[tuple[int, float, float, int]]] = {}
    for table in _tables(wish):
        if table.protocol in ("all", "draws") and table.images:
            for row in table.rows:
                cell = row.cells.get(table.summary.name)
                if cell is not None:
                    points.setdefault(row.label, []).append((table.images, cell.value, cell.spread or 0.0, row.over))
    counts = sorted({k for line in points.values() for k, *_ in line})
    if len(counts) < 2:
        raise InputError(f"{wish.runs} holds {len(counts)} numbers of images; run photonormal bench --images 8,16,96.")
    over = {k: max(line[3] for lines in points.values() for line in lines if line[0] == k) for k in counts}
    figure = Figure(figsize=(5.0, 3), layout="constrained")
    a = figure.subplots()
    for i, (label, line) in enumerate(points.items()):
        line = sorted(p for p in line if p[3] == over[p[0]])
        x, y, s = ([p[j] for p in line] for j in range(3))
        a.plot(x, y, **_look(i), label=label)
        a.fill_between(
            x,
            [v - d for v, d in zip(y, s, strict=True)],
            [v + d for v, d in zip(y, s, strict=True)],
            color=_look(i)["color"],
            alpha=0.15,
            linewidth=0,
        )
    a.set_xscale("log", base=2)
    a.set_xticks(counts, [str(k) for k in counts])
    a.minorticks_off()
    a.set_xlabel("images")
    a.set_ylabel(summary(max(over.values())))
    a.grid(axis="y", linewidth=0.3)
    figure.legend(loc="outside right center")  # never on a line
    return figure


def seconds(wish: Wish) -> Figure:
    """One mark for each method: seconds for one object from all images, and the error that they buy."""
    table = next((t for t in _tables(wish) if t.protocol == "all" and t.columns), None)
    if table is None:
        raise InputError(f"{wish.runs} holds no errors from all images; run photonormal bench on a set with truth.")
    rows = [r for r in table.rows if table.summary.name in r.cells and r.over == table.over]
    figure = Figure(figsize=(4.8, 3.4), layout="constrained")
    a = figure.subplots()
    points = [(row.cost.solve_s, row.cells[table.summary.name].value) for row in rows]
    for i, (x, y) in enumerate(points):
        a.plot([x], [y], **_look(i) | {"linestyle": "none", "markersize": MARK})
    a.set_xscale("log")
    a.margins(x=0.2, y=0.12)
    a.xaxis.set_major_formatter("{x:g}")
    low, high = a.get_xlim()
    a.xaxis.set_minor_formatter("{x:g}" if high < 12 * low else "")
    a.set_xlabel(f"seconds for one object, without reading ({rows[0].cost.machine})")
    a.set_ylabel(summary(table.over))
    a.grid(linewidth=0.3)
    name_points(figure, a, points, [row.label for row in rows])
    return figure


def name_points(figure: Figure, a: Any, points: list[tuple[float, float]], names: list[str]) -> None:
    """Write a name beside each point where it covers least of other names and points; far ones get a line."""
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    def written(name: str, point: tuple[float, float], far: float, dx: int, dy: int) -> Any:
        line = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 0, "shrinkB": MARK / 2} if far > MARK else None
        sides = {"ha": ("right", "center", "left")[dx + 1], "va": ("top", "center", "bottom")[dy + 1]}
        place = {"xytext": (far * dx, far * dy), "textcoords": "offset points"}
        return a.annotate(name, point, **place, **sides, fontsize=7, arrowprops=line)

    figure.draw_without_rendering()  # fixes where the points are
    border = a.get_window_extent()
    half = MARK / 2 * figure.dpi / 72
    taken = [Bbox.from_extents(x - half, y - half, x + half, y + half) for x, y in a.transData.transform(points)]
    for name, point in zip(names, points, strict=True):
        tried = []
        for place in PLACES:
            text = written(name, point, *place)
            text.get_window_extent()  # moves it there
            box = Text.get_window_extent(text)  # without its line
            covered = sum(_area(Bbox.intersection(box, other)) for other in taken)
            outside = _area(box) - _area(Bbox.intersection(box, border))
            tried.append((covered + outside, place, box))
            text.remove()
        _, place, box = min(tried, key=lambda t: t[0])
        written(name, point, *place)
        taken.append(box)


def _area(box: Any) -> float:
    return 0.0 if box is None else box.width * box.height


def summary(over: int) -> str:
    """What the vertical axis shows."""
    return f"mean angular error over {over} object{'s' * (over > 1)}, degrees"


def _tables(wish: Wish) -> list[ErrorTable]:
    return tables(wish.runs, wish.methods, [dataset_of(wish)])


def _look(i: int) -> dict[str, Any]:
    """Colour, marker and line of the i-th method; no two are alike."""
    k = len(COLOURS)
    return {
        "color": COLOURS[i % k],
        "marker": MARKERS[(i + i // k) % len(MARKERS)],
        "linestyle": LINES[(i // k) % len(LINES)],
        "markersize": 4,
        "linewidth": 1.2,
    }
