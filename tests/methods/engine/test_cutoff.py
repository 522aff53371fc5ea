"""Dark pictures: whether they were cut off is told by lights of different intensities, and undone."""

from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal.methods.engine.cutoff import Repaired, given_back
from tests.dark import Files, dark, error_deg, in_16_bits, in_memory


@pytest.mark.parametrize("changes", [{}, {"gloss": 0.5}, {"faulty": 10}], ids=str)
def test_what_was_cut_off_is_given_back_and_what_was_rounded_stays(changes):
    cut, rounded = dark(np.floor, **changes), dark(np.round, **changes)
    assert given_back(rounded) is rounded
    raised = given_back(cut)
    before, after = cut.images[3], raised.images[3]
    level = 1 / 255 / cut.images.intensities[3, 0]
    assert np.allclose(after[before > 0], before[before > 0] + level / 2)
    assert (after[before == 0] < level).all() and not after[~cut.mask].any()


def test_normals_are_better_for_it():
    cut, rounded = dark(np.floor), dark(np.round)
    cut_in_memory = replace(cut, images=in_memory(cut))
    assert error_deg(cut) < 0.7 * error_deg(cut_in_memory)
    assert error_deg(rounded) < error_deg(cut_in_memory)


def test_even_lights_tell_nothing():
    capture = dark(np.floor, even=True)
    assert given_back(capture) is capture


def test_few_lights_and_floats_are_left_alone():
    capture = dark(np.floor)
    few = pn.Capture(Files(capture.images.counts[:12], capture.images.intensities[:12]), capture.mask,
                     capture.lights[:12], saturation=capture.saturation[:12])  # fmt: skip
    assert given_back(few) is few
    capture.images.dtype = np.dtype(np.float32)
    assert given_back(capture) is capture


@pytest.mark.parametrize("even", [False, True], ids=["uneven", "even"])
def test_black_stored_as_half_a_level_is_black(even):
    cut, middle = dark(np.floor, even), in_16_bits(dark(np.floor, even), 2, 1)
    repaired = given_back(middle)
    for j in range(3):
        before, after = middle.images[j], repaired.images[j]
        black = cut.images[j] == 0
        assert black.any() and (after[black] < before[black].min() * 2).all()
        assert np.allclose(after[~black], before[~black], rtol=2e-3) and not after[~cut.mask].any()
    assert error_deg(middle) < 0.8 * error_deg(replace(middle, images=in_memory(middle)))


def test_files_of_16_bits_that_hold_8_are_like_those_of_8():
    cut = dark(np.floor)
    wide = in_16_bits(cut, 257, 0)
    assert np.allclose(given_back(wide).images[3], given_back(cut).images[3])
    fine = in_16_bits(cut, 257, 0)
    fine.images.counts[0, 16, 16] += 1
    assert given_back(fine) is fine


def test_it_is_given_back_once():
    raised = given_back(dark(np.floor))
    assert given_back(raised) is raised


def test_pictures_of_enough_levels_keep_their_zeros():
    raised = given_back(dark(np.floor, brightest=120))
    assert isinstance(raised.images, Repaired)
    for j in range(3):
        before, after = raised.images.images[j], raised.images[j]
        assert (before == 0).any() and not after[before == 0].any()


def test_a_measurement_says_so():
    result = pn.measure(dark(np.floor), "woodham", integration=None, albedo=False, expected_error=False)
    assert any("cut off" in warning for warning in result.report["warnings"])
    result = pn.measure(dark(np.round), "woodham", integration=None, albedo=False, expected_error=False)
    assert not any("cut off" in warning for warning in result.report["warnings"])
    result = pn.measure(
        in_16_bits(dark(np.floor), 2, 1), "woodham", integration=None, albedo=False, expected_error=False
    )
    assert any("middle of its step" in warning for warning in result.report["warnings"])


def test_a_window_is_a_part_of_the_picture():
    raised = given_back(dark(np.floor))
    assert np.array_equal(raised.images.window(2, slice(5, 9), slice(3, 8)), raised.images[2][5:9, 3:8])
