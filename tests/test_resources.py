"""What a process may use, and what it used."""

import numpy as np

from photonormal.resources import cores, hand_back, peak_mb, reset_peak


def test_there_is_a_core():
    assert cores() >= 1


def test_a_peak_is_that_since_it_was_reset():
    held = np.ones(2**25)  # 256 MB
    with_it = peak_mb()
    del held
    hand_back()
    reset_peak()
    without = peak_mb()
    assert with_it is None or without is None or with_it - without > 100
