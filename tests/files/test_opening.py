"""Files are opened in one place: what is no regular file, or claims more than memory allows, is refused unread."""

import os
import struct
import sys
import time
import zlib

import numpy as np
import pytest
from scipy.io import savemat

import photonormal as pn
from photonormal.capture.lens import read_lens
from photonormal.export import load_normals
from photonormal.files import memory
from photonormal.files.decode import decode
from photonormal.files.matlab import read_mat
from photonormal.files.opening import open_file
from photonormal.types import InputError
from tests.capture.files import load_and_decode, refusal, samples, write_folder, write_picture

posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no FIFOs")


@pytest.fixture
def little(monkeypatch):
    """A machine that allows one file 2 MB."""
    monkeypatch.setattr(memory, "_given", memory.SHARE * 2_000_000)


@posix
@pytest.mark.parametrize(
    "name", ["light_directions.txt", "light_intensities.txt", "mask.png", "2.png", "Normal_gt.mat"]
)
@pytest.mark.parametrize("what", ["a FIFO", "a device"])
def test_what_is_no_regular_file_is_never_read(tmp_path, name, what):
    folder = write_folder(tmp_path / "owl")
    (folder / name).unlink(missing_ok=True)
    if what == "a FIFO":
        os.mkfifo(folder / name)
    else:
        (folder / name).symlink_to("/dev/zero")
    assert f"{name} is {what}" in refusal(load_and_decode, folder)


def test_a_regular_file_is_opened_whole(tmp_path):
    (tmp_path / "a").write_bytes(b"all of it")
    with open_file(tmp_path / "a") as file:
        assert file.read() == b"all of it"


def png_of(h: int, w: int) -> bytes:
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 0, 0, 0, 0)), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    packed = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


def bmp_of(h: int, w: int) -> bytes:
    return (
        b"BM"
        + struct.pack("<IHHI", 60, 0, 0, 54)
        + struct.pack("<IiiHHIIIIII", 40, w, h, 1, 8, 1, 0, 0, 0, 0, 0)
        + bytes(6)
    )


@pytest.mark.parametrize(("name", "data"), [("a.png", png_of(3000, 1000)), ("a.bmp", bmp_of(3000, 1000))])
def test_a_picture_larger_than_memory_allows_is_not_decoded(tmp_path, little, name, data):
    (tmp_path / name).write_bytes(data)
    assert "such as --memory" in refusal(decode, tmp_path / name)


@pytest.mark.parametrize("suffix", [".tif", ".exr", ".npy", ".jpg"])
def test_so_is_one_of_every_kind(tmp_path, monkeypatch, suffix):
    dtype = np.uint8 if suffix == ".jpg" else np.float32
    path = write_picture(tmp_path / f"a{suffix}", samples(0, dtype))
    assert decode(path).shape == (24, 30, 3)
    monkeypatch.setattr(memory, "_given", memory.SHARE * 2000)
    assert "such as --memory" in refusal(decode, path)


def test_more_memory_is_allowed_on_asking(tmp_path, little):
    folder = write_folder(tmp_path / "owl")
    for text in ("", "3GB", "0.5 tb", "100000 KB"):
        pn.load(folder, memory=text)
    assert memory.allowed() == 100_000_000
    for text in ("3", "GB", "-3GB", "3 PB", "0GB", "nan GB"):
        assert "an amount like 3GB" in refusal(pn.load, folder, memory=text)


def test_a_mask_of_another_size_is_not_decoded(tmp_path):
    folder = write_folder(tmp_path / "owl")
    (folder / "mask.png").write_bytes(png_of(5000, 5000))
    assert "5000 x 5000 pixels but 30 x 24 pixels are needed" in refusal(pn.load, folder)


def test_arrays_larger_than_memory_allows_are_not_unpacked(tmp_path, little):
    savemat(tmp_path / "a.mat", {"Normal_gt": np.zeros((1000, 1000, 3), np.uint8)}, do_compression=True)
    assert "such as --memory" in refusal(read_mat, tmp_path / "a.mat", "Normal_gt")
    assert "is (1000, 1000, 3)" in refusal(read_mat, tmp_path / "a.mat", "Normal_gt", (24, 30, 3))
    np.savez_compressed(tmp_path / "n.npz", normals=np.zeros((1000, 1000, 3), np.float32))
    assert "such as --memory" in refusal(load_normals, tmp_path / "n.npz")


def test_directories_that_point_to_themselves_end(tmp_path):
    (tmp_path / "a.tif").write_bytes(b"II*\0" + struct.pack("<IHHHIII", 8, 1, 256, 3, 1, 1, 8))
    assert "point to each other" in refusal(decode, tmp_path / "a.tif")


def test_scans_without_end_end(tmp_path):
    path = write_picture(tmp_path / "a.jpg", samples(0, np.uint8))
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"\xff\xda")] + b"\xff\xda" * 1_000_000)
    started = time.process_time()
    assert "scans" in refusal(decode, path)
    assert time.process_time() - started < 10  # it took minutes


def test_a_jpeg_cut_in_half_is_no_picture_with_its_end_mark(tmp_path, capfd):
    path = write_picture(tmp_path / "a.jpg", samples(0, np.uint8))
    data = path.read_bytes()
    path.write_bytes(data[: 2 * len(data) // 3] + b"\xff\xd9")
    assert "Corrupt JPEG data: premature end" in refusal(decode, path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "a.yml",
            "%YAML:1.0\n---\nK: !!opencv-matrix\n  rows: 3\n  cols: -1\n  data: [ 1, 2 ]\nD: [1, 2, 3, 4]\n",
        ),
        ("a.json", '{"K": {"rows": 3, "cols": -1, "data": [1, 2, 3]}, "D": [0, 0, 0, 0]}'),
        ("a.xml", "<?xml version='1.0'?>" + "<a>" * 100_000),
        ("b.xml", "<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>"),
        ("b.json", '{"K":' + "[" * 100_000),
        ("b.yml", "K: " + "[" * 100_000),
        ("c.yml", "K: &a [*a, *a]\nD: *a\n"),
        ("d.yml", "K: [[nan, 0, 0], [0, 1, 0], [0, 0, 1]]\nD: [0, 0, 0, 0]\n"),
        ("e.yml", "K: [[-9, 0, 0], [0, 1, 0], [0, 0, 1]]\nD: [0, 0, 0, 0]\n"),
        ("f.yml", "x" * 2**20),
    ],
)
def test_a_lens_file_is_parsed_as_text_within_a_schema(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert name in refusal(read_lens, tmp_path / name)


class TestContradictions:
    def test_one_photograph_under_two_lights(self, tmp_path):
        folder = write_folder(tmp_path / "owl")
        (folder / "filenames.txt").write_text("1.png\n2.png\n3.png\n1.png")
        assert "1.png is named twice" in refusal(pn.load, folder)
        (folder / "filenames.txt").unlink()
        (folder / "4.png").unlink()
        os.link(folder / "1.png", folder / "4.png")
        assert "1.png is named again as 4.png" in refusal(pn.load, folder)

    def test_equal_photographs(self, tmp_path):
        folder = write_folder(tmp_path / "owl")
        for name in ("3.png", "4.png"):
            (folder / name).write_bytes((folder / "1.png").read_bytes())
        assert "3 photographs (1.png, 3.png, 4.png) are equal" in refusal(load_and_decode, folder)

    def test_black_photographs_may_be_equal(self, tmp_path):
        folder = write_folder(tmp_path / "owl")
        for name in ("3.png", "4.png"):
            write_picture(folder / name, np.zeros((24, 30, 3), np.uint16))
        load_and_decode(folder)


def test_messages_hold_nothing_that_a_terminal_obeys():
    assert str(InputError("red \x1b[31m\u202e\udce9 a\nb")) == "red \\x1b[31m\\u202e\\udce9 a b"
    assert len(str(InputError("x" * 5000))) < 2100
