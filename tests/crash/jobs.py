"""The commands that are killed: what they find, and how to tell what is left of it."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tests.calibration.chrome import dome, write_chrome, write_pictures
from tests.crash.run import Work, command, run
from tests.scenes import lambertian, ring, sphere, write_diligent

MINE = 2000  # files of the user's in the folder of a result
SOME = 100  # in other folders


@dataclass
class Job:
    """A command that writes into `out`.

    `before` makes what is there when it starts; `state` tells what is there: "old" or "new" whole files, "begun" where
    several belong to it of which some are there, each whole, and "broken".
    """

    out: Path
    work: Work
    state: Callable[[], str]
    before: Callable[[], None] = lambda: None
    mine: dict[Path, bytes] = field(default_factory=dict)

    def place_mine(self, folder: Path, count: int) -> Job:
        """Put files of the user's there."""
        folder.mkdir(parents=True, exist_ok=True)
        for i in range(count):
            path = folder / f"mine-{i}.txt"
            path.write_text(f"mine {i}")
            self.mine[path] = path.read_bytes()
        return self


def snapshot(folder: Path) -> dict[str, str]:
    """Digests of the files of a folder, but for the user's; of JSON and of MATLAB's, which hold times, the names."""
    names = (p for p in sorted(folder.rglob("*")) if not p.name.startswith("mine-") and p.is_file())
    return {str(p.relative_to(folder)): _digest(p) for p in names}


def _digest(path: Path) -> str:
    if path.suffix in (".json", ".mat"):
        return "has times"
    if path.suffix == ".npz":
        with np.load(path) as file:
            return hashlib.sha256(b"".join(file[k].tobytes() for k in sorted(file.files))).hexdigest()
    return hashlib.sha256(path.read_bytes()).hexdigest()


def cleared(folder: Path) -> None:
    """Remove all but the user's files."""
    for path in sorted(folder.rglob("*"), reverse=True) if folder.exists() else []:
        if not path.name.startswith("mine-"):
            path.rmdir() if path.is_dir() else path.unlink()


def replacing(job: Job, old: Work) -> Job:
    """A job over the result of `old`, which is made again before each kill."""
    run(old).well()
    was = snapshot(job.out)
    run(job.work).well()
    new = snapshot(job.out)
    assert was != new

    def before() -> None:
        if snapshot(job.out) != was:
            run(old).well()

    job.before = before
    job.state = lambda: {str(was): "old", str(new): "new"}.get(str(snapshot(job.out)), "broken")
    return job


def measure(place: Path) -> Job:
    write_captures(place, 40)
    words = ["--out", place / "result", "--method", "woodham", "--overwrite"]
    job = Job(place / "result", command("measure", place / "b", *words, "--no-mesh"), str)
    return replacing(job.place_mine(job.out, MINE), command("measure", place / "a", *words))


def scratch(place: Path) -> Job:
    """The same of photographs that the memory allowed does not hold: a scratch file does, of which nothing is left."""
    write_captures(place, 150)
    aside = place / "aside"
    aside.mkdir()
    words = ["--out", place / "result", "--method", "woodham", "--overwrite", "--no-mesh"]
    new = command("measure", place / "b", *words, "--memory", "2MB")
    job = Job(place / "result", set_aside(new, aside), str).place_mine(place / "result", SOME)
    replacing(job, command("measure", place / "a", *words))
    job.before()
    refused = run(set_aside(new, aside, full=True))
    assert refused.code == 2 and "scratch file" in refused.errors, refused.errors
    whole = job.state
    assert whole() == "old"
    job.state = lambda: "broken" if any(aside.iterdir()) else whole()
    return job


def write_captures(place: Path, size: int) -> None:
    """Two of the same object, of 9 and of 12 photographs."""
    for name, n in (("a", 8), ("b", 11)):
        write_diligent(place / name, replace(lambertian(sphere(size), ring(n, 60)), truth=None))


def set_aside(work: Work, folder: Path, full: bool = False) -> Work:
    """With scratch files in a folder, which may be on a full disk."""

    def done() -> int:
        from photonormal.files import memory

        os.environ["TMPDIR"], tempfile.tempdir = str(folder), None
        if full:
            memory.shutil.disk_usage = lambda path: SimpleNamespace(free=0)  # type: ignore[assignment]
        return work()

    return done


def calibrate(place: Path) -> Job:
    write_pictures(place / "object", np.full((9, 30, 40), 90, np.uint8), name="{:03d}.png")
    write_chrome(place / "one", dome(9))
    write_chrome(place / "two", dome(9, 40.0))
    words = ["calibrate", place / "object", "--out", place / "rig" / "lights.lp", "--overwrite", "--sphere"]
    job = Job(place / "rig", command(*words, place / "two"), str)
    return replacing(job.place_mine(job.out, SOME), command(*words, place / "one"))


def bench(place: Path) -> Job:
    for k, name in enumerate(("ball", "bear", "cat")):
        write_diligent(place / "root" / "pmsData" / f"{name}PNG", lambertian(sphere(24), ring(6 + k, 60)))
    words = ["bench", "diligent", place / "root", "--methods", "woodham,l1", "--out"]
    run(command(*words, place / "whole")).well()
    out, whole = place / "runs", snapshot(place / "whole")

    def state() -> str:
        """Every prediction that is there is one of the undisturbed run, and has its record."""
        found = snapshot(out)
        right = all(whole.get(name) == digest for name, digest in found.items())
        stored = [name for name in found if name.endswith(".npz") and not name.startswith("truth")]
        paired = all(name.removesuffix(".npz") + ".json" in found for name in stored)
        return "new" if found == whole else "begun" if right and paired else "broken"

    return Job(out, command(*words, out), state, lambda: cleared(out)).place_mine(out, SOME)


def render(place: Path) -> Job:
    words = ["render", "lambert", "--count", "2", "--out"]
    run(command(*words, place / "whole")).well()
    out, whole = place / "made" / "set", snapshot(place / "whole")

    def state() -> str:
        found = snapshot(out) if out.exists() else {}
        return "new" if found == whole else "old" if not found else "broken"

    return Job(out, command(*words, out), state, lambda: cleared(out)).place_mine(place / "made", SOME)


STEPS = 60


def train(place: Path) -> Job:
    out = place / "training"
    run(training(place / "whole")).well()
    whole = weights(place / "whole")[1:]

    def state() -> str:
        """A checkpoint is one of a training that goes on; at its end the weights are to the bit those of `whole`."""
        if not (out / "checkpoint.pt").is_file():
            return "begun"
        step, *found = weights(out)
        if step < STEPS:
            return "begun"
        return {str(whole): "new", str([whole[0], ""]): "begun"}.get(str(found), "broken")

    def before() -> None:
        """A training that has ended begins anew; another one goes on."""
        if (out / WEIGHTS).is_file():
            cleared(out)

    return Job(out, training(out), state, before).place_mine(out, SOME)


WEIGHTS = "lambertian-prior.safetensors"


def training(out: Path) -> Work:
    """A tiny training under the first lines of the command, resumed where it has a checkpoint."""

    def trained(interrupted: Callable[[], bool]) -> int:
        from photonormal.train import checkpoint, loop, validate
        from photonormal.train.recipes import Recipe
        from tests.train.toy import Toy

        validate.BATCHES = 1
        recipe = Recipe(config={"width": 8}, images=(3, 5), batch=4, steps=STEPS, warmup=4, clip=1.0, ema=0.9, reuse=2,
                        ring=3, validate=30)  # fmt: skip
        resume = (out / checkpoint.NAME).exists()
        try:
            loop.train(recipe, out, device="cpu", stream=Toy, save_seconds=0, resume=resume)
        except KeyboardInterrupt:
            return 130
        return 0

    def work() -> int:
        import photonormal_command
        from photonormal import cli

        cli.main = trained  # type: ignore[assignment]
        return photonormal_command.main()

    return work


def weights(out: Path) -> list:
    """The step of a training, a digest of its checkpoint's tensors, and one of its weights file's, if there is one."""
    import torch
    from safetensors.torch import load_file

    state = torch.load(out / "checkpoint.pt", weights_only=True)
    file = _sum(load_file(out / WEIGHTS)) if (out / WEIGHTS).is_file() else ""
    return [state["step"], _sum(state["network"]) + _sum(state["mean"]), file]


def _sum(tensors: dict) -> str:
    import torch

    data = (tensors[name].reshape(-1).view(torch.uint8).numpy().tobytes() for name in sorted(tensors))
    return hashlib.sha256(b"".join(data)).hexdigest()


JOBS = {job.__name__: job for job in (measure, scratch, calibrate, bench, train, render)}
