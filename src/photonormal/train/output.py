"""What a training leaves in its folder: the journal, checkpoints, and at its end the weights with their card."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

import photonormal
from photonormal.disk import at_once, refuse_taken
from photonormal.methods.learned.processor import computing_in
from photonormal.options import Precision
from photonormal.train import checkpoint
from photonormal.train.card import device_name, export
from photonormal.train.journal import NAME as JOURNAL
from photonormal.train.journal import TrainingRecord, refuse_foreign
from photonormal.train.learner import Learner
from photonormal.train.validate import on_real, on_rendered
from photonormal.types import InputError


@dataclass
class Output:
    """The folder of a training, into which its first process writes.

    Parameters
    ----------
    out : the folder
    learner : what learns
    journal : the training's
    exams : name of each rendered exam -> its batches
    data : what checkpoints and cards say of the sets on disk that it learns from; empty: of none
    precision : what the network computes in
    save_seconds : between checkpoints
    """

    out: Path
    learner: Learner
    journal: TrainingRecord
    exams: dict[str, list]
    data: list[dict[str, Any]]
    precision: Precision
    save_seconds: float
    saved: float = field(default_factory=time.monotonic, init=False)

    def finish_step(self, step: int, seconds: Callable[[], float]) -> None:
        """Save a checkpoint if it is due, after so many `seconds` of learning; take the exams if they are."""
        if time.monotonic() - self.saved >= self.save_seconds:
            self.save(step, seconds())
        if step % self.learner.recipe.validate == 0:
            self.examine(step)

    def save(self, step: int, seconds: float) -> None:
        """Write a checkpoint."""
        state = {"step": step, "seconds": seconds, "recipe": self.learner.recipe.as_dict()}
        state |= {"precision": self.precision, "data": self.data}
        checkpoint.save(self.out, state | self.learner.state() | version())
        self.saved = time.monotonic()

    def examine(self, step: int) -> dict[str, dict[str, float]]:
        """Errors on every exam and on the real objects, written into the journal."""
        recipe, device, shown = self.learner.recipe, self.learner.fabric.device, self.learner.shown()
        with computing_in(self.precision):
            found = {kind: on_rendered(shown, exam, recipe) for kind, exam in self.exams.items()}
            found["real"] = on_real(shown, device, recipe)
        for kind, errors in found.items():
            self.journal.write(step, kind, errors)
        return found

    def finish(self, name: str, step: int, seconds: float, origin: dict[str, Any]) -> None:
        """Take the last exams, then write the weights and their card, which also says the `origin` of the weights."""
        recipe, fabric = self.learner.recipe, self.learner.fabric
        facts = {
            "recipe": recipe.as_dict(),
            "data": self.data,
            "network": recipe.network,
            "steps": step,
            "minutes": seconds / 60,
            "errors": self.examine(step),
            "device": f"{fabric.world_size} x {device_name(fabric.device)}",
            "precision": self.precision,
        }
        export(self.out, name, self.learner.shown(), facts | origin | version())
        self.journal.close()


def started(out: Path, name: str) -> None:
    """Make the folder of a training; refuses to write over another one, or over anything else."""
    if (out / checkpoint.NAME).exists():
        raise InputError(f"{out} already holds a training; resume it with --resume or choose another folder.")
    if name != Path(name).name:
        raise InputError(f"--name {name} came but a name without folders is needed; give that.")
    with at_once(out):
        refuse_taken([out / f"{name}.safetensors", out / f"{name}.md"], overwrite=False)
        refuse_foreign(out / JOURNAL)


def version() -> dict[str, str]:
    """The software that trains."""
    return {"photonormal": photonormal.__version__, "torch": str(torch.__version__)}
