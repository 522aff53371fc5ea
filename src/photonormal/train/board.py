"""A training's curves for TensorBoard, written when they come: a full disk is an error here, not in a thread."""

from __future__ import annotations

import os
import socket
import time
import weakref
from pathlib import Path
from typing import Any

from photonormal.disk import unwritable


class Board:
    """A file of events in `folder`, by TensorBoard's own writer of records; ImportError where it is not installed.

    Of the curves of earlier runs, what comes after `step` is left out: this run goes on there.
    """

    def __init__(self, folder: Path, step: int) -> None:
        from tensorboard.compat.proto.event_pb2 import Event  # type: ignore[attr-defined]
        from tensorboard.compat.proto.summary_pb2 import Summary  # type: ignore[attr-defined]
        from tensorboard.summary.writer.record_writer import RecordWriter

        self._event, self._summary = Event, Summary
        self.path = folder / f"events.out.tfevents.{time.time_ns()}.{socket.gethostname()}.{os.getpid()}"
        try:
            folder.mkdir(exist_ok=True)
            file = self.path.open("xb", buffering=0)
        except OSError as error:
            raise unwritable(self.path, error) from None
        self._close = weakref.finalize(self, file.close)
        self._records = RecordWriter(file)
        self._write(file_version="brain.Event:2")
        if step:
            self._write(step=step + 1, session_log={"status": "START"})

    def write(self, kind: str, values: dict[str, float], step: int) -> None:
        """A point of the curve KIND/NAME for each value."""
        points = [self._summary.Value(tag=f"{kind}/{k}", simple_value=v) for k, v in values.items()]
        self._write(step=step, summary=self._summary(value=points))

    def close(self) -> None:
        """Nothing more comes."""
        self._close()

    def _write(self, **what: Any) -> None:
        try:
            self._records.write(self._event(wall_time=time.time(), **what).SerializeToString())
        except OSError as error:
            after = " The training goes on from its checkpoint with --resume."
            raise unwritable(self.path, error, after) from None
