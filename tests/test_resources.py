"""What a process may use, and what it used."""

import numpy as np
import torch
from threadpoolctl import threadpool_info

from photonormal.resources import by_one_thread, cores, hand_back, peak_mb, reset_peak


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


def test_small_steps_take_one_thread_and_others_as_many_as_before():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with by_one_thread():
            assert torch.get_num_threads() == 1
            assert all(pool["num_threads"] == 1 for pool in threadpool_info() if pool["user_api"] == "blas")
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
