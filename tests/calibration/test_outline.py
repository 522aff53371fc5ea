"""Circles of edges."""

from __future__ import annotations

import numpy as np

from photonormal.calibration.outline import outlines


def test_in_a_photograph_one_pixel_thin_no_circle_runs_off_to_a_line():
    for seed in range(4):
        levels = np.random.default_rng(seed).random((300, 1)).astype(np.float32)
        assert max(c.r for c in outlines([np.repeat(levels, 8, axis=1)], 8, pixel=8.0)) < 300
