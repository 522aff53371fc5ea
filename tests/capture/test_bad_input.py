"""What can't be used is refused in one line, and by nothing but InputError."""

import os
import pickle
import warnings

import numpy as np
import pytest

from photonormal import InputError, load
from photonormal.capture import FORMATS
from tests.capture.files import LIGHTS, MASK, load_and_decode, refusal, samples, write_folder, write_picture


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "owl")


class TestPictures:
    @pytest.mark.parametrize("j", [1, 3])
    @pytest.mark.parametrize(
        ("damage", "came"),
        [
            (lambda data: data[: len(data) // 2], "truncated"),
            (lambda data: b"", "0 bytes"),
            (lambda data: b"\0" * 1000, "no PNG"),
            (lambda data: b"<html>not found</html>", "no PNG"),
        ],
    )
    def test_unreadable(self, folder, capfd, j, damage, came):
        path = folder / f"{j}.png"
        path.write_bytes(damage(path.read_bytes()))
        message = refusal(load_and_decode, folder)
        assert came in message and f"{j}.png" in message
        assert capfd.readouterr() == ("", "")

    @pytest.mark.parametrize(
        ("picture", "came"),
        [
            (samples()[1:], "30 x 23 pixels"),
            (samples()[..., :1], "30 x 24 pixels of one channel, 16-bit samples"),
            (samples(0, np.uint8), "30 x 24 pixels of 3 channels, 8-bit samples"),
        ],
    )
    def test_of_two_kinds(self, folder, picture, came):
        write_picture(folder / "3.png", picture)
        message = refusal(load_and_decode, folder)
        assert came in message and "3.png" in message

    def test_turned(self, folder):
        write_picture(folder / "3.png", np.rot90(samples(2)))
        assert (
            "24 x 30 pixels but 30 x 24" in (message := refusal(load_and_decode, folder)) and "turn it back" in message
        )

    @pytest.mark.parametrize("n", [1, 2])
    def test_fewer_than_three(self, tmp_path, n):
        assert f"{n} images came" in refusal(load, write_folder(tmp_path, n))
        assert "at least 3" in refusal(load, write_folder(tmp_path, 4), images=f"1-{n}")

    def test_listed_but_absent(self, folder):
        (folder / "filenames.txt").write_text("1.png\n2.png\nabsent.png\n4.png")
        assert "absent.png is missing" in refusal(load, folder)

    def test_listed_but_a_folder(self, folder):
        (folder / "5.png").mkdir()
        load_and_decode(folder)
        (folder / "filenames.txt").write_text("1.png\n2.png\n3.png\n5.png")
        assert "5.png is missing" in refusal(load, folder)

    def test_removed_after_loading(self, folder):
        capture = load(folder)
        (folder / "3.png").unlink()
        assert "3.png is missing" in refusal(capture.map_images, lambda j, image: None)


class TestLights:
    @pytest.mark.parametrize("n", [3, 5])
    def test_another_count(self, folder, n):
        np.savetxt(folder / "light_directions.txt", np.concatenate([LIGHTS, LIGHTS])[:n])
        assert f"4 pictures but {n} light directions" in refusal(load, folder)

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0])
    def test_no_direction(self, folder, value):
        lights = LIGHTS.copy()
        lights[2] = value
        np.savetxt(folder / "light_directions.txt", lights)
        assert "the light of 3.png is [" in refusal(load, folder)

    def test_in_one_plane(self, folder):
        phi = np.arange(4.0)
        np.savetxt(folder / "light_directions.txt", np.stack([np.cos(phi), 0 * phi, np.sin(phi)], axis=-1))
        assert "condition number" in refusal(load, folder)

    @pytest.mark.parametrize("text", ["", "\n", "1 2\n3 4", "x y z", "\0\0\0", "0 0 1\n0 0"])
    def test_no_table(self, folder, text):
        (folder / "light_directions.txt").write_text(text)
        assert "light_directions.txt" in refusal(load, folder)

    @pytest.mark.parametrize("name", ["absent.txt", "absent.lp", "absent.csv", "."])
    def test_given_but_no_file(self, folder, name):
        assert "needed" in refusal(load, folder, lights=folder / name)

    @pytest.mark.parametrize("value", [0, -1, np.nan, np.inf])
    def test_no_intensity(self, folder, value):
        np.savetxt(folder / "light_intensities.txt", [[1], [1], [value], [1]])
        assert "row 3" in refusal(load, folder)

    def test_another_count_of_intensities(self, folder):
        np.savetxt(folder / "light_intensities.txt", np.ones((5, 3)))
        assert "(5, 3)" in refusal(load, folder)


class TestMask:
    def test_of_another_size(self, folder):
        write_picture(folder / "mask.png", MASK[:, 1:].astype(np.uint8))
        message = refusal(load, folder)
        assert "29 x 24 pixels" in message and "30 x 24 pixels" in message

    def test_empty(self, folder):
        write_picture(folder / "mask.png", 0 * MASK.astype(np.uint8))
        assert "mask is empty" in refusal(load, folder)

    @pytest.mark.parametrize("data", [b"", b"junk", b"\x89PNG\r\n\x1a\n"])
    def test_unreadable(self, folder, data):
        (folder / "mask.png").write_bytes(data)
        assert "mask.png" in refusal(load, folder)

    @pytest.mark.parametrize("name", ["absent.png", ".", "light_directions.txt"])
    def test_given_but_no_picture(self, folder, name):
        refusal(load, folder, mask=folder / name)

    def test_a_pickle_is_never_opened(self, folder, tmp_path):
        class Bomb:
            def __reduce__(self):
                return os.mkdir, (str(tmp_path / "trace"),)

        (folder / "mask.png").unlink()
        np.save(folder / "mask.npy", np.array([Bomb()], object), allow_pickle=True)
        refusal(load, folder)
        (folder / "mask.npy").write_bytes(pickle.dumps(Bomb()))
        refusal(load, folder)
        assert not (tmp_path / "trace").exists()


class TestPaths:
    def test_nothing_there(self, tmp_path):
        assert "does not exist" in refusal(load, tmp_path / "absent")

    @pytest.mark.parametrize("path", ["a\0b", "a" * 5000, "line\nbreak", ""])
    def test_names_that_can_be_no_path(self, path, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        refusal(load, path)

    @pytest.mark.parametrize("format", ["auto", *FORMATS])
    def test_a_file_where_a_folder_is_needed(self, folder, format):
        if format != "rti":  # which takes lights by any name, and the pictures beside them
            refusal(load, folder / "light_directions.txt", format=format)
        refusal(load, folder / "1.png", format=format)

    @pytest.mark.parametrize("format", [f for f in FORMATS if f != "folder"])
    def test_a_folder_of_another_format(self, folder, format):
        refusal(load, folder, format=format)

    @pytest.mark.parametrize("format", ["auto", *FORMATS])
    def test_an_empty_folder(self, tmp_path, format):
        refusal(load, tmp_path, format=format)

    def test_an_unknown_format(self, folder):
        assert "no format 'png'; choose from auto, diligent" in refusal(load, folder, format="png")
        assert "no format 'diligant'; perhaps diligent is meant" in refusal(load, folder, format="diligant")

    def test_a_folder_named_like_an_lp(self, folder):
        refusal(load, folder.rename(folder.with_suffix(".lp")) / "absent.lp")
        load_and_decode(folder.with_suffix(".lp"))

    @pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read everything")
    @pytest.mark.parametrize("name", [".", "1.png", "2.png", "light_directions.txt", "mask.png"])
    def test_no_permission(self, folder, name):
        (folder / name).chmod(0)
        try:
            assert "ermission" in refusal(load_and_decode, folder)
        finally:
            (folder / name).chmod(0o700)

    def test_a_line_break_in_a_name_stays_one_line(self, folder):
        refusal(load, folder, mask=folder / "line\nbreak\r.png")


def only_input_errors(call, *args, **options) -> None:
    """Run what may fail: with an InputError of one line, or not at all."""
    with warnings.catch_warnings(action="error"):
        try:
            call(*args, **options)
        except InputError as error:
            assert len(str(error).splitlines()) == 1


CELLS = [
    "0",
    "1",
    "-7",
    "0.5",
    "0,5",
    "1e300",
    "nan",
    "-inf",
    "1e999",
    ",",
    ";",
    "",
    "#",
    '"',
    "é 1",
    "1.png",
    "../owl",
]


def texts(count: int):
    """Bytes without sense, and lines of cells that have some."""
    rng = np.random.default_rng(count)
    for _ in range(count):
        rows = [" ".join(rng.choice(CELLS, rng.integers(6))) for _ in range(rng.integers(6))]
        yield rng.bytes(int(rng.integers(60)))
        yield "\n".join(rows).encode()
        yield "\n".join([str(len(rows)), *rows]).encode()
        yield "\n".join(" ".join(rng.choice(CELLS[:9], 3)) for _ in range(4)).encode()


@pytest.mark.parametrize(
    "name", ["light_directions.txt", "light_intensities.txt", "filenames.txt", "lights.csv", "rig.lp"]
)
def test_any_bytes_in_a_text_file(folder, name):
    if name == "lights.csv":
        (folder / "light_directions.txt").unlink()
    for data in texts(40):
        (folder / name).write_bytes(data)
        only_input_errors(load_and_decode, folder)


def test_any_choice_of_images(folder):
    rng = np.random.default_rng(0)
    for _ in range(300):
        only_input_errors(load, folder, images="".join(rng.choice(list("0123499--,, é\n.²")) for _ in range(5)))


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".exr", ".npy"])
def test_any_change_to_a_picture(tmp_path, suffix):
    dtype = {".exr": np.float32, ".jpg": np.uint8, ".bmp": np.uint8}.get(suffix, np.uint16)
    write_folder(tmp_path, suffix=suffix, dtype=dtype)
    path, rng = tmp_path / f"2{suffix}", np.random.default_rng(0)
    data = path.read_bytes()
    for k in range(60):
        changed = bytearray(data)
        for place in rng.integers(0, len(data) if k % 2 else min(len(data), 300), 3):
            changed[place] = rng.integers(256)
        path.write_bytes(changed)
        only_input_errors(load_and_decode, tmp_path)
