"""Numbers in text files, as people and their programs write them."""

import os
import unicodedata

import numpy as np
import pytest

from photonormal.capture.lights.match import finder
from photonormal.capture.texts import (
    beside,
    number,
    read_intensities,
    read_lines,
    read_table,
    spellings,
)
from tests.capture.files import refusal

TABLE = [[0, 0.5, 1], [-0.25, 0.125, 1e-3]]


@pytest.mark.parametrize(
    "text",
    [
        "0 0.5 1\n-0.25 .125 1e-3",
        "0 0.5 1\r\n-0.25 .125 1e-3\r\n\r\n",
        "\n  0\t0.5\t1  \n\n-0.25   +.125 1E-3 \n \n",
        "0,0.5,1\n-0.25,.125,0.001\n",
        "0, 0.5, 1\n-0.25, .125, 0.001",
        "0; 0.5; 1\n-0.25; .125; 0.001",
        "0;0,5;1\n-0,25;,125;0,001",
        "0,0 0,5 1,0\n-0,25 0,125 0,001",
        "# x y z\n0 0.5 1\n# remark\n-0.25 .125 .001",
        "0 0.5 1\r-0.25 .125 .001",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_table_is_read_however_it_is_written(tmp_path, text, encoding):
    (tmp_path / "a.txt").write_bytes(text.encode(encoding))
    np.testing.assert_array_equal(read_table(tmp_path / "a.txt"), TABLE)


def test_one_column_with_decimal_commas(tmp_path):
    (tmp_path / "a.txt").write_text("1,5\n0,25\n")
    np.testing.assert_array_equal(read_table(tmp_path / "a.txt"), [[1.5], [0.25]])


@pytest.mark.parametrize(
    "text", ["", "\n\n", "# only a remark\n", "0 1\n0 1 2", "0 one 2", "0 0.5 1..2", ";", "0 1;\n;"]
)
def test_no_table(tmp_path, text):
    (tmp_path / "a.txt").write_text(text)
    assert "needed" in refusal(read_table, tmp_path / "a.txt")


def test_binary_junk(tmp_path):
    (tmp_path / "a.txt").write_bytes(np.random.default_rng(0).bytes(2000))
    assert "is no text" in refusal(read_table, tmp_path / "a.txt")


def test_names_in_old_encodings_and_with_odd_spaces(tmp_path):
    (tmp_path / "a.txt").write_bytes("Gefäß 1.png\r\nb\x85c.png\r\n".encode("latin-1"))
    names = read_lines(tmp_path / "a.txt")
    assert [spellings(n)[-1] for n in names] == ["Gefäß 1.png", "b\x85c.png"]
    for name in ("Gefäß 1.png".encode("latin-1"), "Gefäß 1.png".encode()):  # on disk: the very bytes, and UTF-8
        file = tmp_path / os.fsdecode(name)
        file.write_bytes(b"")
        assert beside(tmp_path, names[0]) == file
        file.unlink()


@pytest.mark.parametrize(("listed", "stored"), [("NFC", "NFD"), ("NFD", "NFC"), ("latin-1", "NFD")])
def test_accents_may_be_part_of_a_letter_or_follow_it(tmp_path, listed, stored):
    name, file = "Gefäß é.png", tmp_path / unicodedata.normalize(stored, "Gefäß é.png")
    file.write_bytes(b"")
    (tmp_path / "a.txt").write_bytes(
        name.encode(listed) if listed == "latin-1" else unicodedata.normalize(listed, name).encode()
    )
    (found,) = read_lines(tmp_path / "a.txt")
    assert beside(tmp_path, found) == file
    assert finder([file.name])(found) == 0


def test_missing_and_folder(tmp_path):
    assert "is missing" in refusal(read_lines, tmp_path / "a.txt")
    assert "Is a directory" in refusal(read_lines, tmp_path)


def test_a_decimal_comma():
    assert number("-0,34") == -0.34
    with pytest.raises(ValueError):
        number("1,2,3")


class TestIntensities:
    @pytest.mark.parametrize("shape", [(5, 1), (5, 3), (1, 5), (3, 5)])
    def test_shapes(self, tmp_path, shape):
        table = np.arange(1.0, 1 + np.prod(shape)).reshape(shape)
        np.savetxt(tmp_path / "a.txt", table)
        read = read_intensities(tmp_path / "a.txt", 5)
        np.testing.assert_array_equal(read, table if shape[0] == 5 else table.T)

    @pytest.mark.parametrize("shape", [(4, 3), (5, 2), (6, 1), (5, 4)])
    def test_wrong_count(self, tmp_path, shape):
        np.savetxt(tmp_path / "a.txt", np.ones(shape))
        assert str(shape) in refusal(read_intensities, tmp_path / "a.txt", 5)

    @pytest.mark.parametrize("value", [0, -1, np.nan, np.inf])
    def test_no_intensity(self, tmp_path, value):
        table = np.ones((5, 3))
        table[2, 1] = value
        np.savetxt(tmp_path / "a.txt", table)
        assert "row 3" in refusal(read_intensities, tmp_path / "a.txt", 5)
