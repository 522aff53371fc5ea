"""RTI captures: `.lp` files of many programs."""

import numpy as np
import pytest

from photonormal import load
from tests.capture.files import LIGHTS, MASK, box, refusal, samples, write_folder, write_picture

NAMES = ("DSC 0001.png", "DSC 0002.png", "Ä 壺.png", "plain.png")


@pytest.fixture
def folder(tmp_path):
    for j, name in enumerate(NAMES):
        write_picture(tmp_path / "my rti" / name, samples(j))
    return tmp_path / "my rti"


def lp(numbers=LIGHTS, names=NAMES, count=None) -> str:
    rows = [" ".join([name, *map(str, l)]) for name, l in zip(names, numbers, strict=True)]
    return "\n".join([str(len(rows) if count is None else count), *rows]) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        lp(),
        lp(17.5 * LIGHTS),
        lp().replace(".0", ",0").replace("0.", "0,"),
        lp().replace("\n", "\r\n") + "\r\n  \r\n",
        "\ufeff" + lp(),
        lp().replace(".png ", ".png\t").replace("\n", "  \n"),
        lp(names=[f"C:\\Users\\me\\jpeg exports\\{n}" for n in NAMES]),
        lp(names=[f"/Users/me/{n}" for n in NAMES]),
        lp(names=[f'"{n}"' for n in NAMES]),
        lp(names=[f"./{n}" for n in NAMES]),
    ],
)
def test_the_same_capture_however_it_is_written(folder, text):
    (folder / "rig.lp").write_bytes(text.encode())
    for path in (folder, folder / "rig.lp"):
        capture = load(path)
        assert (capture.name, capture.image_names) == ("my rti", NAMES)
        np.testing.assert_allclose(capture.known_lights(), LIGHTS, atol=1e-9)
        np.testing.assert_allclose(capture.images[2], samples(2) / 65535, rtol=1e-6)


@pytest.mark.parametrize("slash", ["/", "\\"])
def test_names_are_relative_to_the_lp(folder, slash):
    for j, name in enumerate(NAMES):
        write_picture(folder / "exports" / name, samples(j + 5))
    (folder / "a.lp").write_text(lp(names=[f"exports{slash}{n}" for n in NAMES]))
    np.testing.assert_allclose(load(folder).images[0], samples(5) / 65535, rtol=1e-6)


def test_pictures_may_lie_in_a_folder_below_the_list_and_its_mask(folder, tmp_path):
    below = tmp_path / "object"
    below.mkdir()
    folder.rename(below / "DCIM")
    write_picture(below / "mask.png", MASK.astype(np.uint8))
    (below / "a.lp").write_text(lp(names=[f"D:\\other\\{n.upper()}" for n in NAMES]))
    for path in (below, below / "a.lp"):
        capture = load(path)
        assert capture.image_names == NAMES and (capture.mask == MASK).all() and capture.notes == ()


def test_pictures_that_the_list_does_not_name_are_left_out_and_told(folder):
    (folder / "a.lp").write_text(lp(LIGHTS[:3], NAMES[:3]))
    (folder / "DSC 0001.tif").write_bytes(b"the same shot in another format")
    capture = load(folder)
    assert capture.image_names == NAMES[:3]
    assert capture.notes == ("Left out, since the list in a.lp has no light for them: plain.png.",)


def test_the_folder_s_mask(folder):
    (folder / "a.LP").write_text(lp())
    write_picture(folder / "mask.png", MASK.astype(np.uint8))
    capture = load(folder / "a.LP")
    np.testing.assert_array_equal(capture.mask, MASK)
    np.testing.assert_allclose(capture.images[0], box(samples(0) / 65535), rtol=1e-6)


def test_a_light_file_of_another_name(folder):
    (folder / "lights.txt").write_text(lp())
    np.testing.assert_allclose(load(folder / "lights.txt", format="rti").known_lights(), LIGHTS, atol=1e-9)


@pytest.mark.parametrize("count", ["-4", "9" * 5000, "4.0", "four", "٤", "0x4"])
def test_counts_that_are_none(folder, count):
    (folder / "a.lp").write_text(lp(count=count), "utf-8")
    assert "correct" in refusal(load, folder)


@pytest.mark.parametrize("line", ["plain.png 1 2", "plain.png 1 2 x", "1 2 3", "plain.png", "plain.png 1 2 3,4,5"])
def test_a_line_that_is_none(folder, line):
    (folder / "a.lp").write_text("\n".join([*lp().splitlines()[:4], line]))
    assert "line 5 of" in refusal(load, folder)


def test_an_empty_file_and_two_files(folder):
    (folder / "a.lp").touch()
    assert "holds no lights" in refusal(load, folder)
    (folder / "b.lp").write_text(lp())
    assert "2 .lp files (a.lp, b.lp)" in refusal(load, folder)
    for capture in (load(folder / "b.lp"), load(folder, lights=folder / "b.lp")):
        order = [NAMES.index(name) for name in capture.image_names]
        np.testing.assert_allclose(capture.known_lights(), LIGHTS[order], atol=1e-9)


def test_a_picture_that_is_not_there(folder):
    (folder / "plain.png").unlink()
    (folder / "a.lp").write_text(lp())
    assert "plain.png is missing" in refusal(load, folder)
    assert load(folder, images="1-3").images.shape[0] == 3


@pytest.mark.parametrize("name", ["x" * 5000 + ".png", "a\0b.png", ".", "..", "/"])
def test_names_that_can_be_no_file(folder, name):
    (folder / "a.lp").write_text(lp(names=[*NAMES[:3], name]))
    refusal(load, folder)


def test_a_folder_without_lp(tmp_path):
    write_folder(tmp_path)
    assert "0 .lp files" in refusal(load, tmp_path, format="rti")
