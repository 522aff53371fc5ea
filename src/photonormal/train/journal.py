"""What a training reports: a progress bar with rate and time left, lines of JSON, and TensorBoard."""

from __future__ import annotations

import errno
import logging
import math
import os
import sys
import time
import weakref
from pathlib import Path
from typing import Any

import msgspec
import torch

from photonormal.disk import lock, unwritable
from photonormal.train.board import Board
from photonormal.types import InputError

log = logging.getLogger(__name__)

NAME = "journal.jsonl"
LONGEST = 2**16  # bytes of a line
EVERY = 50  # steps between two entries


class TrainingRecord:
    """The first process's record of a training, in `out`/journal.jsonl and `out`/tensorboard."""

    def __init__(self, out: Path, step: int, steps: int, minutes: float | None, loss: str = "cosine") -> None:
        self.path = out / NAME
        self.file = _opened(self.path)
        self._unlock = weakref.finalize(self, os.close, self.file)
        self.steps, self.minutes, self.loss = steps, minutes, loss
        self.last_step, self.last_time = step, time.monotonic()
        self.losses: list[torch.Tensor] = []
        try:
            self.board: Board | None = Board(out / "tensorboard", step)
        except ImportError:
            self.board = None
        self.bar: Any = None
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

            text = TextColumn("{task.description}")
            self.bar = Progress(
                text, BarColumn(), TimeElapsedColumn(), TimeRemainingColumn(), console=Console(stderr=True)
            )
            self.task = self.bar.add_task("starting", total=1.0)
            self.bar.start()

    def step(self, step: int, fraction: float, loss: torch.Tensor, rate: float, batch: int) -> None:
        """Take note of one step; every EVERY steps, write it down."""
        self.losses.append(loss)  # read only when written: a GPU need not wait
        if self.bar:
            self.bar.update(self.task, completed=fraction)
        if step % EVERY and step != 1:
            return
        now = time.monotonic()
        mean = float(torch.stack(self.losses).mean())
        degrees = loss_angle_deg(mean, self.loss)
        samples = batch * (step - self.last_step) / max(now - self.last_time, 1e-9)
        entry = {"loss": mean, "lr": rate, "samples_per_s": samples, "fraction": fraction}
        self.write(step, "train", entry | ({"loss_angle_deg": degrees} if degrees is not None else {}))
        if self.bar:
            loss_now = f"{mean:.3f}" if degrees is None else f"{degrees:.2f} deg"
            self.bar.update(self.task, description=f"step {step}: loss {loss_now}, {samples:.0f} samples/s")
        self.losses, self.last_step, self.last_time = [], step, now

    def write(self, step: int, kind: str, values: dict[str, float]) -> None:
        """One entry, in all places."""
        if not values:
            return
        entry = {"step": step, "kind": kind, **{k: round(v, 6) for k, v in values.items()}}
        self._add(msgspec.json.encode(entry) + b"\n")
        log.info("step %d, %s: %s", step, kind, ", ".join(f"{k} {v:.4g}" for k, v in values.items()))
        if self.board:
            self.board.write(kind, values, step)

    def _add(self, line: bytes) -> None:
        """A whole line, or none."""
        size = os.fstat(self.file).st_size
        try:
            if os.write(self.file, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            os.ftruncate(self.file, size)
            raise unwritable(self.path, error, " The training goes on from its checkpoint with --resume.") from None

    def close(self) -> None:
        """Finish the bar and the board, and let another process train here."""
        self._unlock()
        if self.bar:
            self.bar.stop()
        if self.board:
            self.board.close()


def loss_angle_deg(loss: float, kind: str) -> float | None:
    """The angle that a loss of normals stands for, in degrees; None of other losses."""
    if kind == "cosine":
        return math.degrees(math.acos(max(-1.0, 1 - loss)))
    return math.degrees(2 * math.asin(min(1.0, loss / 2))) if kind == "chord" else None


def refuse_foreign(path: Path) -> None:
    """InputError where the journal of a new training would be added to a file that is no journal of a training."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        first = file.readline(LONGEST)
    try:
        ours = not first or {"step", "kind"} <= set(msgspec.json.decode(first))
    except (msgspec.DecodeError, TypeError, RecursionError):
        ours = False
    if not ours:
        raise InputError(f"{path} is no journal of a training and is not written into; choose another --out.")


def _opened(path: Path) -> int:
    """The file, locked while the training goes on."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
    except OSError as error:
        raise unwritable(path, error) from None
    if not lock(file):
        os.close(file)
        raise InputError(
            f"{path.parent} is being trained in by another photonormal; wait for it or choose another --out."
        )
    return file
