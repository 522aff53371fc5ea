"""Arrays on disk are the arrays that were stored, whichever rows are asked for."""

import shutil

import numpy as np
import pytest

from photonormal.errors import InputError
from photonormal.files import rows
from photonormal.files.rows import Rows, npz_rows

VALUES = np.random.default_rng(0).random((50, 7, 3)).astype(np.float32)


def test_rows_are_what_was_put_there_and_zero_before():
    with Rows((50, 7, 3), np.float32) as kept:
        kept[10:20] = VALUES[10:20]
        assert np.array_equal(kept[10:20], VALUES[10:20]) and not kept[:10].any() and kept[5:5].shape == (0, 7, 3)
        kept[:] = VALUES
        assert np.array_equal(kept[:], VALUES) and np.array_equal(kept[3:40:7], VALUES[3:40:7])
        kept[1:3] = 5
        assert (kept[1:3] == 5).all() and np.array_equal(kept[3:4], VALUES[3:4])


def test_a_disk_without_room_is_told(monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10**6, 10**6, 1000))
    with pytest.raises(InputError, match=r"4\.2 KB is needed but .* has 1 KB free; .*TMPDIR"):
        Rows((50, 7, 3), np.float32)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_of_a_file_are_copied_in_any_order_of_theirs(tmp_path, monkeypatch, save):
    monkeypatch.setattr(rows, "BLOCK", 1000)
    file = tmp_path / "a.npz"
    save(file, plain=VALUES, turned=np.asfortranarray(VALUES), mask=VALUES > 0.5, other=np.zeros(3))
    with npz_rows(file, "save it again", ("plain", "turned", "mask", "missing")) as found:
        assert found.keys() == {"plain", "turned", "mask"}
        assert all(np.array_equal(found[name][4:33], VALUES[4:33]) for name in ("plain", "turned"))
        assert found["mask"].dtype == bool and np.array_equal(found["mask"][:], VALUES > 0.5)


def test_what_is_no_array_of_numbers_is_refused(tmp_path):
    file = tmp_path / "a.npz"
    np.savez(file, a=VALUES)
    file.write_bytes(file.read_bytes()[:-400])
    with pytest.raises(InputError, match="save it again"), npz_rows(file, "save it again", ("a",)):
        pass
    np.savez(file, a=np.array(["text"]))
    with pytest.raises(InputError, match="not rows of numbers"), npz_rows(file, "save it again", ("a",)):
        pass
    with pytest.raises(InputError, match="is missing"), npz_rows(tmp_path / "b.npz", "save it again", ("a",)):
        pass
