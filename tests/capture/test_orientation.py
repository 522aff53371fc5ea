"""Masks drawn on photographs as viewers show them."""

import re

import numpy as np
import pytest

import photonormal as pn
from photonormal.types import InputError
from tests.capture.embedding import exif, write_with
from tests.capture.files import LIGHTS, refusal, write_picture

STORED = np.zeros((24, 30), bool)
STORED[2:9, 3:14] = True
SHOWN = {  # what a viewer makes of the stored rows and columns (Exif 2.32, orientation)
    1: STORED,
    2: STORED[:, ::-1],
    3: STORED[::-1, ::-1],
    4: STORED[::-1],
    5: STORED.T,
    6: STORED[::-1].T,
    7: STORED[::-1, ::-1].T,
    8: STORED[:, ::-1].T,
}


def capture(path, mask, orientations=(3, 3, 3, 3)):
    """Pictures of a bright patch on a dark ground."""
    rng = np.random.default_rng(0)
    for j, orientation in enumerate(orientations):
        picture = np.where(STORED, 180, 20)[..., None] + rng.integers(0, 20, (24, 30, 3))
        write_with(path / f"{j + 1}.png", picture.astype(np.uint8), exif=exif(orientation=orientation))
    np.savetxt(path / "light_directions.txt", LIGHTS)
    write_picture(path / "mask.png", mask.astype(np.uint8) * 255)
    return path


@pytest.mark.parametrize("orientation", SHOWN)
def test_a_mask_drawn_on_what_viewers_show_is_turned_back(tmp_path, orientation):
    found = pn.load(capture(tmp_path, SHOWN[orientation], 4 * [orientation]))
    np.testing.assert_array_equal(found.mask, STORED)
    assert [("turned back" in note) for note in found.notes] == ([True] if orientation > 1 else [])


@pytest.mark.parametrize("orientation", [2, 3, 4, 6])
def test_a_mask_drawn_on_the_samples_stays(tmp_path, orientation):
    found = pn.load(capture(tmp_path, STORED, 4 * [orientation]))
    np.testing.assert_array_equal(found.mask, STORED)
    assert len(found.notes) == (orientation != 6)  # which only fits as it is


def test_notes_may_change_while_a_camera_looks_down(tmp_path):
    found = pn.load(capture(tmp_path, SHOWN[8], (1, 6, 8, 8)))
    np.testing.assert_array_equal(found.mask, STORED)


def test_pictures_stay_as_the_sensor_saw_them(tmp_path):
    found = pn.load(capture(tmp_path, STORED))
    assert found.images[0][STORED].min() > 0.6 > found.images[0][~STORED].max()


def test_a_mask_that_fits_both_ways_is_refused_until_it_is_said_how_it_was_drawn(tmp_path):
    part = np.zeros_like(STORED)
    part[3:5, 4:6] = True  # of the patch, which is seen on both sides of the middle
    wide = np.zeros_like(STORED)
    wide[1:23, 2:28] = True
    for j in range(4):
        picture = np.where(wide, 170 + j, 20)[..., None].repeat(3, -1)
        write_with(tmp_path / f"{j + 1}.png", picture.astype(np.uint8), exif=exif(orientation=3))
    np.savetxt(tmp_path / "light_directions.txt", LIGHTS)
    write_picture(tmp_path / "mask.png", part.astype(np.uint8) * 255)
    message = refusal(pn.load, tmp_path)
    assert "orientation" in message and "--mask-on stored" in message and "180 degrees" in message
    np.testing.assert_array_equal(pn.load(tmp_path, mask_on="stored").mask, part)
    with pytest.raises(InputError, match="stored or shown"):
        pn.load(tmp_path, mask_on="screen")
    np.testing.assert_array_equal(pn.load(tmp_path, mask_on="shown").mask, part[::-1, ::-1])


def test_a_mask_that_is_the_same_both_ways_needs_no_choice(tmp_path):
    whole = np.ones_like(STORED)
    assert pn.load(capture(tmp_path, whole)).mask.all()


def test_another_size_is_refused(tmp_path):
    assert "20 x 20 pixels" in refusal(pn.load, capture(tmp_path, np.ones((20, 20), bool), 4 * [6]))


@pytest.mark.parametrize(("orientation", "right"), [(3, [-1, 0]), (6, [0, 1]), (8, [0, -1])])
def test_where_a_ring_begins_is_said_of_pictures_that_viewers_turn(tmp_path, orientation, right):
    """`right`: x, y in what is stored at the right of what viewers show."""
    folder = capture(tmp_path, STORED, 4 * [orientation])
    (folder / "mask.png").unlink()
    (folder / "light_directions.txt").unlink()
    found = pn.load(folder, ring=4, elevation=45)
    start = float(re.search(r"add (-?[0-9]+) to --start\.$", found.notes[0]).group(1))
    light = pn.load(folder, ring=4, elevation=45, start=start).known_lights()[0]
    np.testing.assert_allclose(light[:2] * 2**0.5, right, atol=1e-9)
