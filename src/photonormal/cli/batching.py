"""Commands for many captures."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import tyro
from tyro.conf import OmitArgPrefixes, Positional

from photonormal.cli.kinds import Number, shown, tell
from photonormal.cli.measuring import How, Written, of_job
from photonormal.cli.photographs import Corrections, Files, Lights, Photographs, Read


@dataclass(frozen=True)
class Going:
    """How a batch goes on."""

    sphere: Annotated[str, shown("auto|FOLDER")] = ""
    """Find lights from a mirror sphere: auto: in each capture, where it shows one; FOLDER: in each, or one for all."""
    jobs: Number = None
    """Captures at a time, each in its own process; by default as many as cores and memory allow."""
    scheduler: Annotated[str, shown("ADDRESS")] = ""
    """Let the workers of a Dask cluster measure, which see the same folders: tcp://192.168.1.2:8786."""
    workers: Number = None
    """Let so many workers of a Dask cluster on this machine measure."""
    retry: Annotated[Literal["", "failed"], shown("failed")] = ""
    """Try again what has failed before."""
    overwrite: bool = False
    """Measure again what was measured with other options, and write beside what is no result of photonormal."""
    json_lines: bool = False
    """Print what happens as a JSON object in each line."""


@dataclass(frozen=True)
class Batch:
    """Results of many captures, one process each; what is done is not done again."""

    captures: Positional[tuple[str, ...]]
    """Patterns such as 'season/*', folders, .lp files, and lists (.csv, .toml) of captures with their own options."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Folder for a folder of results for each capture, and the summary of all."""
    read: Read = field(default_factory=Photographs)
    method: OmitArgPrefixes[How] = field(default_factory=How)
    results: OmitArgPrefixes[Written] = field(default_factory=Written)
    batch: OmitArgPrefixes[Going] = field(default_factory=Going)

    def __call__(self) -> int:
        from photonormal.batch.captures import jobs
        from photonormal.batch.cluster import cluster
        from photonormal.batch.run import run
        from photonormal.batch.workers import run as processes
        from photonormal.files.memory import allow
        from photonormal.job import AUTO, Job

        going, reading = self.batch, self.read.how()
        allow(reading.pop("memory"))
        sphere = AUTO if going.sphere == "auto" else going.sphere
        if sphere and Path(sphere).is_dir():
            sphere = str(Path(sphere).resolve())
        how = of_job(self.method, self.results)
        like = Job(Path(), self.out, reading, sphere=sphere, overwrite=going.overwrite, **how)
        found = jobs(self.captures, self.out, like, kinds())
        tells = as_lines if going.json_lines else in_words
        clustered = going.scheduler or going.workers
        local = nullcontext(partial(processes, jobs=going.jobs))
        with cluster(going.scheduler, going.workers) if clustered else local as measured:
            done = run(found, self.out, tells, measured, going.retry == "failed", going.overwrite)
        return 1 if done["failed"] else 0


def kinds() -> dict[str, Any]:
    """The options that a list of captures may give, and their kinds."""
    groups = (Files, Lights, Corrections, How, Written)
    found = {name: kind for group in groups for name, kind in get_type_hints(group, include_extras=True).items()}
    return {name: kind for name, kind in found.items() if name not in ("memory", "device")} | {"sphere": str}


def as_lines(event: str, **what: Any) -> None:
    """An event as a line of JSON on standard output."""
    import json

    print(json.dumps({"event": event, **what}, default=str), flush=True)


def in_words(event: str, **what: Any) -> None:
    """What a person wants to know of an event."""
    if event == "failed":
        tell(f"{what['capture']}: {what['message']}")
    elif event == "stale":
        tell(f"{what['capture']} is measured again: {what['why']}")
    elif event == "summary":
        failed = f", {what['failed']} failed; --retry failed tries those again" if what["failed"] else ""
        print(f"{what['measured']} measured, {what['kept']} were done{failed}: {what['out']}")
        sys.stdout.flush()
