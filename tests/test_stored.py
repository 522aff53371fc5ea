"""Stored files: of the kind that was written, of bounded size and depth, or one line that names the file."""

import io
import json
import os
import zipfile

import numpy as np
import pytest

from photonormal import stored
from photonormal.files import memory
from photonormal.files.opening import read_npz
from photonormal.options import Whole
from photonormal.stored import Name, read_json, stored_bytes
from photonormal.types import InputError

KIND = dict[str, Whole]
DAMAGED = {
    "empty": b"",
    "half": b'{"a": 1',
    "another shape": b"[1]",
    "another type": b'{"a": "1"}',
    "out of range": b'{"a": -1}',
    "deep": b'{"a": ' + b"[" * 100_000,
    "no number": b'{"a": NaN}',
    "long number": b'{"a": ' + b"9" * 5000 + b"}",
    "no text": b'{"\xff": 1}',
    "lone surrogate": b'{"\\ud800": 1}',
}


@pytest.mark.parametrize("data", DAMAGED.values(), ids=DAMAGED)
def test_damaged_json_is_one_line_that_names_the_file(tmp_path, data):
    path = tmp_path / "a.json"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"a\.json can't be read \(.+\); get it again\.$") as told:
        read_json(path, KIND, "get it again")
    assert len(str(told.value).splitlines()) == 1 and len(str(told.value)) < 500


def test_what_fits_is_read_and_what_is_not_known_is_left_out(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps({"a": 1, "b": 0}))
    assert read_json(tmp_path / "a.json", KIND, "") == {"a": 1, "b": 0}


@pytest.mark.parametrize("name", ["../a", "/a", "a/../b", "a\\b", "a\nb", "\x1b[31m", "", "x" * 2000])
def test_names_stay_below_their_folder(name):
    with pytest.raises(InputError):
        stored.converted(name, Name, "name", "rename it")


def test_only_regular_files_of_bounded_size_are_read(tmp_path):
    (tmp_path / "long").write_bytes(bytes(100))
    os.mkfifo(tmp_path / "pipe")
    for name, says in (
        ("long", "at most 99"),
        ("pipe", "is a FIFO"),
        (".", "Is a directory"),
        ("absent", "No such file"),
    ):
        with pytest.raises(InputError, match=says):
            stored_bytes(tmp_path / name, "give another", 99)


def npz(**members):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def npy(array, shape=None):
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue().replace(b"(2, 2)", b"(2, 9)") if shape else buffer.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"PK\x03\x04 half",
        npz(a=b"no array"),
        npz(a=npy(np.array([{}], object))),
        npz(a=npy(np.array(["text"]))),
        npz(a=npy(np.ones((2, 2)), shape="larger than its bytes")),
    ],
)
def test_arrays_are_numbers_that_the_file_holds(tmp_path, data):
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(InputError, match=r"a\.npz can't be read"):
        read_npz(tmp_path / "a.npz", "save it again")


def test_arrays_larger_than_memory_allows_are_not_unpacked(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(2**20))
    assert read_npz(tmp_path / "a.npz", "")["a"].shape == (2**20,)
    monkeypatch.setattr(memory, "_given", 2**20)
    with pytest.raises(InputError, match=r"would take 8\.4 MB but one file may take"):
        read_npz(tmp_path / "a.npz", "save it again")
