"""Lamps that the shadows of a small sphere tell, where its highlights do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from photonormal.calibration import faint
from photonormal.calibration.mirror import directions
from photonormal.calibration.shadow import Surroundings
from photonormal.geometry import angle_deg
from tests.calibration.chrome import dome
from tests.calibration.test_shadow import BALL, highlights, scene

LIGHTS = dome(24, 70)[2:]  # where the first stand the ball hides its shadow


def test_where_a_shadow_lies_tells_its_lamp():
    around, right = Surroundings.of([np.sqrt(p) for p in scene(LIGHTS)]), highlights(LIGHTS)
    off = 0.02 * BALL.r * np.random.default_rng(0).standard_normal(right.shape)
    for found in (faint.near(around, BALL, right + off), faint.anywhere(around, BALL, np.full_like(right, np.nan))):
        assert angle_deg(directions(BALL, found)[0], LIGHTS).mean() < 1.5


def test_an_outline_that_is_off_is_half_mended_by_highlights_and_shadows_together_unless_highlights_are_noise():
    around, right = Surroundings.of([np.sqrt(p) for p in scene(LIGHTS)]), highlights(LIGHTS)
    off = replace(BALL, x=BALL.x + 0.4, r=1.03 * BALL.r)
    mended = faint.agreed(around, off, right)
    before, after = (angle_deg(directions(c, right)[0], LIGHTS).mean() for c in (off, mended))
    assert before > 2 and after == pytest.approx(before / 2, rel=0.1)  # half of the way
    assert faint.agreed(around, off, right[::-1]) == off


def test_shadows_turn_around_a_sphere_and_not_around_places_of_a_relief():
    pictures, rng = scene(LIGHTS), np.random.default_rng(4)
    for picture in pictures:
        picture[:, :90] *= np.kron(rng.random((40, 15)) < 0.5, np.ones((6, 6)))
    first = faint.turned_around(Surroundings.of([np.sqrt(p) for p in pictures]))[0]
    assert np.hypot(first.x - BALL.x, first.y - BALL.y) < 1 and abs(first.r - BALL.r) < 2


def test_what_mirrors_is_brighter_in_each_picture_where_its_own_lamp_would_be():
    xy, rng = highlights(LIGHTS), np.random.default_rng(1)
    y, x = np.mgrid[:240, :320]
    noise = 0.01 * rng.standard_normal((len(xy), 240, 320)).astype(np.float32)
    spots = np.stack([0.02 * np.exp(-((x - a) ** 2 + (y - b) ** 2) / 3) for a, b in xy]).astype(np.float32)
    assert faint.mirrored(noise + spots, xy, pixel=1.0)
    assert not faint.mirrored(noise, xy, pixel=1.0)
    assert not faint.mirrored(noise + spots.mean(0), xy, pixel=1.0)  # the same in all pictures is no lamp's


def test_highlights_count_less_the_farther_they_are_from_where_shadows_say():
    cast, rng = highlights(LIGHTS), np.random.default_rng(2)
    fine, noisy = (cast + part * BALL.r * rng.standard_normal(cast.shape) for part in (0.003, 0.03))
    assert np.abs(faint.moved(fine, cast, BALL) - fine).max() < 0.1 * 0.003 * BALL.r
    left = faint.moved(noisy, cast, BALL) - cast
    assert np.abs(left).max() < 0.2 * np.abs(noisy - cast).max()


def test_a_highlight_without_a_shadow_stays_unless_the_others_are_noise():
    cast, rng = highlights(LIGHTS), np.random.default_rng(3)
    for part, stays in ((0.005, True), (0.1, False)):
        xy = cast + part * BALL.r * rng.standard_normal(cast.shape)
        told = cast.copy()
        told[2] = np.nan
        assert np.isfinite(faint.moved(xy, told, BALL)[2]).all() == stays
