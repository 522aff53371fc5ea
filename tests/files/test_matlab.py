"""Arrays in MATLAB files."""

import os
import pickle

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from photonormal.files.matlab import read_mat
from photonormal.types import InputError
from tests.capture.files import refusal

MAP = np.random.default_rng(0).normal(size=(9, 7, 3))


@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("dtype", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_any_number_comes_back(tmp_path, compressed, dtype):
    map = (100 * np.abs(MAP)).astype(dtype)
    beside = {"cells": np.array(["a", 3], object), "a": "text", "record": {"x": 1}, "Normal": MAP}
    savemat(tmp_path / "a.mat", {**beside, "Normal_gt": map, "z": 1}, do_compression=compressed)
    np.testing.assert_array_equal(read_mat(tmp_path / "a.mat", "Normal_gt"), map)
    np.testing.assert_array_equal(read_mat(tmp_path / "a.mat", "z"), [[1]])  # packed into four bytes


@pytest.mark.parametrize("content", ["text", np.array(["a", 3], object), {"field": 1}, MAP * 1j], ids=type)
def test_what_is_no_number(tmp_path, content):
    savemat(tmp_path / "a.mat", {"Normal_gt": content})
    assert "no real numbers" in refusal(read_mat, tmp_path / "a.mat", "Normal_gt")


def test_another_name(tmp_path):
    savemat(tmp_path / "a.mat", {"Normal_gt2": MAP})
    assert "no array Normal_gt but" in refusal(read_mat, tmp_path / "a.mat", "Normal_gt")


@pytest.mark.parametrize("compressed", [True, False])
def test_truncated(tmp_path, compressed):
    savemat(tmp_path / "a.mat", {"Normal_gt": MAP}, do_compression=compressed)
    data = (tmp_path / "a.mat").read_bytes()
    for left in (0, 4, 100, 127, 128, 130, 150, 200, len(data) // 2, len(data) - 1):
        (tmp_path / "a.mat").write_bytes(data[:left])
        assert "a.mat" in refusal(read_mat, tmp_path / "a.mat", "Normal_gt")


@pytest.mark.parametrize("compressed", [True, False])
def test_any_change(tmp_path, compressed):
    savemat(tmp_path / "a.mat", {"Normal_gt": MAP, "cells": np.array(["a", 3], object)}, do_compression=compressed)
    data, rng = (tmp_path / "a.mat").read_bytes(), np.random.default_rng(1)
    for k in range(300):
        changed = bytearray(data)
        for place in rng.integers(100, len(data) if k % 2 else 240, 1 + k % 3):
            changed[place] = rng.integers(256)
        (tmp_path / "a.mat").write_bytes(changed)
        try:
            read_mat(tmp_path / "a.mat", "Normal_gt")
        except InputError as error:
            assert len(str(error).splitlines()) == 1


HDF = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384) + b"\x89HDF\r\n\x1a\n"


@pytest.mark.parametrize("data", [b"", b"junk", b"junk" * 99, HDF], ids=["empty", "short", "junk", "7.3"])
def test_other_files(tmp_path, data):
    (tmp_path / "a.mat").write_bytes(data)
    assert "version" in refusal(read_mat, tmp_path / "a.mat", "Normal_gt")


def test_missing_and_folder(tmp_path):
    assert "is missing" in refusal(read_mat, tmp_path / "a.mat", "Normal_gt")
    assert "Is a directory" in refusal(read_mat, tmp_path, "Normal_gt")


def test_a_pickle_is_never_opened(tmp_path):
    class Bomb:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "trace"),)

    (tmp_path / "a.mat").write_bytes(pickle.dumps(Bomb()).ljust(400))
    refusal(read_mat, tmp_path / "a.mat", "Normal_gt")
    assert not (tmp_path / "trace").exists()


@pytest.mark.data
def test_true_normals_of_real_captures(data):
    paths = sorted(data.glob("diligent/pmsData/*/Normal_gt.mat"))
    assert len(paths) >= 4
    for path in paths:
        np.testing.assert_array_equal(read_mat(path, "Normal_gt"), loadmat(path)["Normal_gt"])
