import time

import numpy as np
import pytest

from photonormal import types
from photonormal.methods.albedo import lambertian_albedo
from photonormal.types import Capture, InputError
from tests.scenes import lambertian, ring, sphere


class Slow:
    """Images that come in another order each time."""

    def __init__(self, images, seed, damaged=-1):
        self.images, self.shape, self.dtype, self.damaged = images, images.shape, images.dtype, damaged
        self.delays = np.random.default_rng(seed).permutation(len(images)) / 1000

    def __getitem__(self, j):
        time.sleep(self.delays[j])
        if j == self.damaged:
            raise InputError("damaged")
        return self.images[j]


@pytest.fixture
def capture(monkeypatch):
    monkeypatch.setattr(types, "cores", lambda: 4)
    return lambertian(sphere(24), ring(12))


def slow(capture, seed, **how):
    grain = np.random.default_rng(0).random(capture.images.shape, np.float32)
    return Capture(Slow(capture.images + grain, seed, **how), capture.mask, capture.lights)


def test_the_albedo_is_the_same_to_the_bit_in_whatever_order_pictures_are_decoded(capture):
    found = [lambertian_albedo(slow(capture, seed), capture.truth) for seed in range(8)]
    assert all(np.array_equal(one, found[0]) for one in found)


def test_a_damaged_picture_among_others_ends_in_its_error(capture):
    with pytest.raises(InputError, match="damaged"):
        lambertian_albedo(slow(capture, 0, damaged=3), capture.truth)
