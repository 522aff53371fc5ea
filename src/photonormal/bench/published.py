"""Published figures, from published.toml: only ever shown beside measured ones, never mixed with them."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from photonormal.bench.benchmarks import DILIGENT
from photonormal.methods import METHODS

FILE = Path(__file__).with_name("published.toml")


@dataclass(frozen=True)
class Published:
    """One row of a published table.

    Parameters
    ----------
    name : as the source calls the method
    method : the method of this package that it is set beside; "": none
    values : column -> figure, as printed
    cite, where : the source and the place in it
    remark : what is known to be wrong with it, or different about it
    """

    table: str
    dataset: str
    images: int
    protocol: str
    name: str
    method: str
    values: dict[str, float]
    cite: str
    where: str
    remark: str

    def value(self, column: str, objects: list[str]) -> float | None:
        """A column's figure. "average" is as printed where it is over these objects, else the mean of theirs."""
        if column != "average":
            return self.values.get(column)
        known = [o for o in self.values if o not in ("average", "bear76")]
        if "average" in self.values and set(known or DILIGENT) == set(objects):
            return self.values["average"]
        if not objects or not set(objects) <= set(known):
            return None
        return sum(self.values[o] for o in objects) / len(objects)


@cache
def published() -> tuple[Published, ...]:
    """All rows of the data file, in its order."""
    content = tomllib.loads(FILE.read_text(encoding="utf-8"))
    return tuple(
        Published(
            table=table["id"],
            dataset=table["dataset"],
            images=table["images"],
            protocol=table["protocol"],
            name=row["name"],
            method=row.get("method", ""),
            values={c: v for c, v in zip(table["columns"], row["values"], strict=True) if not math.isnan(v)},
            cite=content["source"][table["source"]]["cite"],
            where=table["where"],
            remark="; ".join(r for r in (row.get("remark", ""), table.get("remark", "")) if r),
        )
        for table in content["table"]
        for row in table["rows"]
    )


def of_method(method: str, dataset: str, images: int, protocol: str) -> tuple[Published, ...]:
    """The rows that a measured one is set beside: of the same protocol first, then others of as many images."""
    rows = [r for r in published() if r.method == method and (r.dataset, r.images) == (dataset, images)]
    return tuple(sorted(rows, key=lambda r: r.protocol != protocol))


def others(dataset: str, images: int) -> list[Published]:
    """Rows of methods that this package does not have; of a name printed twice, the first."""
    found: dict[str, Published] = {}
    for r in published():
        if r.method not in METHODS and (r.dataset, r.images) == (dataset, images):
            found.setdefault(r.name.split(" [")[0].rstrip("†"), r)
    return list(found.values())
