"""Commands for many captures."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import tyro
from tyro.conf import OmitArgPrefixes, Positional

from photonormal.cli.kinds import Number, say_no_more, shown, tell
from photonormal.cli.measuring import How, Written, of_job
from photonormal.cli.photographs import Corrections, Files, LightOptions, Photographs, Read
from photonormal.options import Positive
from photonormal.types import InputError, a_few

if TYPE_CHECKING:
    from photonormal.batch.work import Measured
    from photonormal.job import Job


@dataclass(frozen=True)
class Going:
    """How the captures are worked through."""

    jobs: Number = None
    """How many captures are measured at a time, each in its own process; by default as cores and memory allow."""
    scheduler: Annotated[str, shown("ADDRESS")] = ""
    """Address of a Dask scheduler, such as tcp://192.168.1.2:8786; its workers measure, and see the same folders."""
    workers: Number = None
    """Start a Dask cluster of N workers on this machine, and let them measure."""
    split_megapixels: Annotated[Positive | None, shown("MEGAPIXELS")] = None
    """Share a capture among all workers of the cluster, some rows each, if its photographs are larger than this."""
    overwrite: bool = False
    """Replace results of other options, and write into folders that hold other files, too."""
    json_lines: bool = False
    """Print each event as one line of JSON."""

    def measured(self, soon: bool) -> AbstractContextManager[Measured]:
        """What measures the captures: processes of this machine, or a cluster's workers; `soon`: it is certain that
        they will be needed."""
        from photonormal.batch.cluster import cluster
        from photonormal.batch.workers import begin_loading, work_through

        if self.scheduler or self.workers:
            if self.jobs:
                raise InputError("--jobs came but a cluster measures with its own workers; leave --jobs out.")
            return cluster(self.scheduler, self.workers, self.split_megapixels)
        if self.split_megapixels:
            raise InputError(
                "--split-megapixels needs a cluster with workers that share a capture; add --scheduler or --workers."
            )
        if soon:
            begin_loading()
        return nullcontext(partial(work_through, jobs=self.jobs))

    def tells(self, watching: bool = False) -> Callable[..., None]:
        """What reports events."""
        return as_lines if self.json_lines else while_watching if watching else in_words


@dataclass(frozen=True)
class Batch:
    """Measure many captures, several at a time; captures that have a result are kept."""

    captures: Positional[Annotated[tuple[str, ...], shown("CAPTURE")]]
    """Folders, .lp files, patterns such as 'season/*', or lists (.csv, .toml) of captures with options of their own."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Folder to write: one folder of results for each capture, and a summary of all."""
    read: Read = field(default_factory=Photographs)
    method: OmitArgPrefixes[How] = field(default_factory=How)
    results: OmitArgPrefixes[Written] = field(default_factory=Written)
    batch: OmitArgPrefixes[Going] = field(default_factory=Going)

    retry: Annotated[Literal["", "failed"], shown("failed")] = ""
    """Try captures again that failed before."""

    def __call__(self) -> int:
        from photonormal.batch.captures import jobs

        like, going = of_all(self), self.batch
        found = jobs(self.captures, self.out, like, kinds())
        with going.measured(soon=not all(os.path.exists(named.job.out) for named in found.captures)) as measured:
            from photonormal.batch.run import run_batch

            done = run_batch(found, self.out, going.tells(), measured, self.retry == "failed", going.overwrite)
        return 1 if done["failed"] else 0


@dataclass(frozen=True)
class Watch:
    """Measure captures as they come into a folder, and keep a summary of all; Ctrl-C ends it."""

    folder: Positional[Path]
    """Folder into which a camera or a person puts one folder for each capture."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
    """Folder to write: one folder of results for each capture, and a summary of all."""
    settle: Annotated[Positive, tyro.conf.arg(metavar="SECONDS")] = 10.0
    """Measure a capture once none of its files has changed for so long: more than the time between two photographs."""
    read: Read = field(default_factory=Photographs)
    method: OmitArgPrefixes[How] = field(default_factory=How)
    results: OmitArgPrefixes[Written] = field(default_factory=Written)
    batch: OmitArgPrefixes[Going] = field(default_factory=Going)

    def __call__(self) -> int:
        from photonormal.batch.captures import jobs
        from photonormal.batch.run import run_batch
        from photonormal.batch.watch import watch

        like, going = of_all(self), self.batch
        with going.measured(soon=True) as measured:
            tells = going.tells(watching=True)

            def measure(paths: Sequence[Path]) -> None:
                found = jobs([str(path) for path in paths], self.out, like, {})
                run_batch(found, self.out, tells, measured, overwrite=going.overwrite)

            watch(self.folder, self.out, measure, self.settle, tell=tells)
        return 0


def of_all(command: Batch | Watch) -> Job:
    """How all captures of a command are measured."""
    from photonormal.files.memory import allow
    from photonormal.job import Job

    going, reading = command.batch, command.read.how()
    allow(reading.pop("memory"))
    how = of_job(command.method, command.results)
    return Job(Path(), command.out, reading, overwrite=going.overwrite, **how)


def kinds() -> dict[str, Any]:
    """The options that a list of captures may give, and their kinds."""
    groups = (Files, LightOptions, Corrections, How, Written)
    found = {name: kind for group in groups for name, kind in get_type_hints(group, include_extras=True).items()}
    return {name: kind for name, kind in found.items() if name not in ("memory", "device")}


def as_lines(event: str, **what: Any) -> None:
    """An event as a line of JSON on standard output, as long as anyone reads it."""
    import json

    try:
        sys.stdout.write(json.dumps({"event": event, **what}, default=str) + "\n")  # at once: threads report, too
        sys.stdout.flush()
    except BrokenPipeError:
        say_no_more()
        tell("nobody reads the events any more, but the batch goes on.")


def in_words(event: str, **what: Any) -> None:
    """What a person wants to know of an event."""
    if event == "found" and (others := what["left_out"]):
        tell(f"left out, since only folders and .lp files are captures: {a_few(others, 5)}")
    elif event == "failed":
        tell(f"{what['capture']}: {what['message']}")
    elif event == "stale":
        tell(f"{what['capture']} is measured again: {what['why']}")
    elif event == "busy":
        tell(f"waiting for another photonormal, which measures {', '.join(what['captures'])}.")
    elif event == "summary":
        failed = f", {what['failed']} failed; --retry failed tries those again" if what["failed"] else ""
        print(f"{what['measured']} measured, {what['kept']} were done{failed}: {what['out']}")
        sys.stdout.flush()


def while_watching(event: str, **what: Any) -> None:
    """What a person wants to know of an event while captures come."""
    if event == "watching":
        tell(f"watching {what['folder']}; {Path(what['out']) / 'index.html'} is the summary; Ctrl-C ends it.")
    elif event == "loose":
        tell(
            f"{what['picture']} lies in {what['folder']} itself and is not measured: put each object's photographs "
            "into a folder of their own there."
        )
    elif event == "done":
        expected = what.get("expected_error_deg")
        off = "" if expected is None else f", expected to be off by {expected:.1f} degrees on average"
        print(f"{what['capture']}: {what['pixels']} normals{off}", flush=True)
    elif event != "summary":
        in_words(event, **what)
