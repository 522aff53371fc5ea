"""Samples of dark pictures: channels say of each other what they were, a pixel's other samples what its zeros were."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal.methods.engine import zeros
from photonormal.methods.engine.cutoff import given_back
from photonormal.methods.engine.zeros import Filled, crossed, expectation, shading
from tests.dark import Files, dark, error_deg, in_memory

FAINT = 6  # levels of the brightest sample
TINTED = (1.0, 0.8, 0.55)


def test_zeros_come_near_what_the_light_was():
    cut, exact = dark(np.floor, brightest=FAINT), dark(lambda x: x, brightest=FAINT)
    seen = given_back(cut)
    assert isinstance(seen.images, Filled)
    level = seen.images.size[:, 0]
    before, after, true = ((in_memory(c)[..., 0] / level[:, None, None])[:, cut.mask] for c in (cut, seen, exact))
    lit = (before > 0).mean(0)
    zero = (before == 0) & (lit > zeros.ENOUGH[1])
    assert zero.sum() > 1000
    assert np.sqrt(np.mean((after - true)[zero] ** 2)) < 0.3 * np.sqrt(np.mean((before - true)[zero] ** 2))
    assert not after[(before == 0) & (lit < zeros.ENOUGH[0])].any()


@pytest.mark.parametrize(("method", "share"), [("trimmed", 0.7), ("l1", 0.9)])
def test_normals_are_better_for_it(method, share):
    filled = given_back(dark(np.floor, brightest=FAINT))
    assert error_deg(filled, method) < share * error_deg(filled.images.capture, method)


def test_channels_of_a_sample_hold_more_than_each():
    cut, exact = (dark(stored, brightest=FAINT, hue=TINTED) for stored in (np.floor, lambda x: x))
    seen = given_back(cut)
    level = seen.images.size[:, None, None]
    counts, before, after, true = ((in_memory(c) / level)[:, cut.mask] for c in (cut, seen.images.capture, seen, exact))
    lit = counts.max(-1) > 0.5
    assert ((after >= counts - 0.01) & (after <= counts + 1.01))[lit].all()  # within what was written
    off_before, off_after = (np.abs((x - true).mean(-1)[lit]) for x in (before, after))
    assert off_after.mean() < 0.78 * off_before.mean()


def test_channels_that_are_alike_stay_as_they_are():
    counts = torch.tensor([[0.5, 1.5, 7.5]]).T.expand(3, 3)
    assert torch.allclose(crossed(counts, torch.full((3, 3), 0.4)), counts)


def test_where_much_light_is_expected_a_zero_is_a_shadow():
    expected, lit = expectation(torch.tensor([-1.0, 0.0, 0.3, 0.7, 3.0, 20.0]))
    assert expected[0] == 0 and abs(float(expected[1])) < 0.01
    assert torch.allclose(expected[2:4], torch.tensor([0.3, 0.7]), atol=0.1)
    assert (expected[4:] < 0.15).all() and (lit[4:] < 0.01).all()


def test_a_pixel_that_is_all_black_stays_so():
    told = shading(torch.zeros(2, 20, 3), np.full((20, 3), 0.1, np.float32), dark(np.floor).lights[:20])
    assert torch.isfinite(told).all() and not told[:, 0].any()


def test_rows_by_rows_it_is_the_same(monkeypatch):
    cut = dark(np.floor)
    whole = in_memory(given_back(cut))
    monkeypatch.setattr(zeros, "SAMPLES", 1)
    rows = given_back(cut).images
    assert rows.rows == 1
    for j in (0, 7):
        assert np.allclose(rows[j], whole[j], atol=1e-3 * whole.max())
        assert np.array_equal(rows.window(j, slice(5, 40), slice(3, 33)), rows[j][5:40, 3:33])
        assert np.array_equal(rows.window(j, slice(5, 40, 4), slice(3, 33)), rows[j][5:40:4, 3:33])


def test_the_order_of_the_images_changes_nothing():
    cut = dark(np.floor)
    order = np.random.default_rng(0).permutation(len(cut.lights))
    files = Files(cut.images.counts[order], cut.images.intensities[order])
    mixed = replace(cut, images=files, lights=cut.lights[order], saturation=cut.saturation[order])
    whole = in_memory(given_back(cut))
    assert np.allclose(in_memory(given_back(mixed)), whole[order], atol=1e-3 * whole.max())


def test_a_measurement_says_so():
    result = pn.measure(dark(np.floor), "woodham", integration=None, albedo=False, expected_error=False)
    assert any("few grey levels" in warning for warning in result.report["warnings"])
    bright = dark(np.floor, brightest=120)
    result = pn.measure(bright, "woodham", integration=None, albedo=False, expected_error=False)
    assert not any("few grey levels" in warning for warning in result.report["warnings"])
