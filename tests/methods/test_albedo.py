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


def test_highlights_and_shadows_do_not_change_the_albedo_where_most_lights_show_neither():
    truth, lights = sphere(32), ring(24, elevation_deg=50)
    matt = lambertian(truth, lights)
    half = lights + np.array([0, 0, 1])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = 5 * np.einsum("hwc,nc->nhw", truth.map, half).clip(0) ** 200
    images = (np.asarray(matt.images) + shine[..., None]).astype(np.float32)
    images[3:6, :, 16:] = 0.01  # in a shadow
    found = lambertian_albedo(Capture(images, truth.mask, lights), truth)[..., 0]
    seen = (np.asarray(matt.images)[..., 0] > 0).sum(0) > 18
    plain = (images[..., 0] * np.asarray(matt.images)[..., 0]).sum(0)[seen] / 0.7
    plain /= (np.asarray(matt.images)[..., 0] ** 2).sum(0)[seen] / 0.49
    assert np.quantile(np.abs(plain - 0.7), 0.9) > 0.1  # what least squares say
    assert np.quantile(np.abs(found[seen] - 0.7), 0.9) < 0.01


def test_a_highlight_that_is_far_brighter_than_a_dark_surface_is_not_taken_for_its_colour():
    truth, lights = sphere(32), ring(24, elevation_deg=50)
    matt = lambertian(truth, lights)
    images = 0.05 * np.asarray(matt.images)
    images[::6] += 3 * np.asarray(matt.images)[::6] ** 2  # a fifth of the lights show one
    found = lambertian_albedo(Capture(images.astype(np.float32), truth.mask, lights), truth)[..., 0]
    seen = (np.asarray(matt.images)[..., 0] > 0).sum(0) > 18
    assert np.quantile(np.abs(found[seen] / (0.05 * 0.7) - 1), 0.9) < 0.02


def test_in_a_hollow_that_most_lights_do_not_reach_the_albedo_is_not_that_of_the_shadows():
    truth, lights = sphere(24), ring(20, elevation_deg=60)
    matt = lambertian(truth, lights)
    seen = (np.asarray(matt.images)[..., 0] > 0.1).all(0)
    shadow = np.tile([0.05, 0.25, 0.25, 1, 1], 5)[: len(lights)]  # some are dark, in others is light from other parts
    images = np.asarray(matt.images) * shadow[:, None, None, None]
    found = lambertian_albedo(Capture(images.astype(np.float32), truth.mask, lights), truth)[..., 0]
    assert np.abs(found[seen] - 0.7).max() < 0.03


def test_of_a_matt_surface_the_albedo_is_exact():
    matt = lambertian(sphere(24), ring(12))
    assert np.abs(lambertian_albedo(matt, matt.truth)[matt.mask] - 0.7).max() < 1e-5
