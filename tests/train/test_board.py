"""TensorBoard reads what a training tells, and a full disk is one error."""

import sys

import pytest

from photonormal.train.board import Board
from photonormal.types import InputError


def test_curves_go_on_where_a_training_does(tmp_path):
    for step in (0, 2):  # the first run had come to step 3 when it was killed, its checkpoint to step 2
        board = Board(tmp_path / "tensorboard", step)
        for k in range(step + 1, step + 4):
            board.write("train", {"loss": 10.0 * k + step, "lr": 1.0}, k)
        board.close()
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    read = accumulator.EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert read.Tags()["scalars"] == ["train/loss", "train/lr"]
    assert [(p.step, p.value) for p in read.Scalars("train/loss")] == [(1, 10), (2, 20), (3, 32), (4, 42), (5, 52)]


@pytest.mark.skipif(sys.platform != "linux", reason="it needs /dev/full")
def test_a_full_disk_is_one_error(tmp_path, capfd):
    board = Board(tmp_path / "tensorboard", 0)
    board._records._writer = open("/dev/full", "wb", buffering=0)
    with pytest.raises(InputError, match=r"tfevents\S+ can't be written: no space is left.* --resume\.$"):
        board.write("train", {"loss": 1.0}, 1)
    board._records.close()
    board.close()
    assert capfd.readouterr().err == ""
