"""Photographs of one row, or one column, are no objects as thin as that: what is seen in them goes on beside them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal.geometry import angle_deg
from photonormal.methods import configure
from photonormal.methods.contract import Solution
from photonormal.methods.engine import run
from photonormal.methods.engine.narrow import with_border
from tests.scenes import lambertian, ring, sphere

BALL = lambertian(sphere(32), ring(7, 50))


def part(rows, columns):
    return replace(BALL, images=BALL.images[:, rows, columns], mask=BALL.mask[rows, columns], truth=None)


def repeated(capture, times, axis):
    """The surface goes on unchanged across the row."""
    images, mask = np.repeat(capture.images, times, axis + 1), np.repeat(capture.mask, times, axis)
    return replace(capture, images=images, mask=mask)


@pytest.mark.parametrize("method", ["normalnet", "psfcn"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_row_is_seen_as_the_same_row_among_its_like(method, axis):
    one = part(*((slice(11, 12), slice(None)) if axis == 0 else (slice(None), slice(11, 12))))
    alone, among = pn.solve(one, method), pn.solve(repeated(one, 17, axis), method)
    middle = among.map.take([8], axis)
    assert alone.map.shape == (*one.mask.shape, 3) and (alone.mask == one.mask).all()
    assert angle_deg(alone.map[one.mask], middle[one.mask]).mean() < 2


def test_lights_of_each_pixel_stay_with_it():
    one = part(slice(11, 14), slice(None))
    each = np.random.default_rng(0).normal(size=(int(one.mask.sum()), 8, 3)).astype(np.float32)

    def first_light(wide):
        return Solution(torch.from_numpy(wide.lights_at[:][:, 0]))

    found = with_border(first_light, replace(one, lights_at=each))
    np.testing.assert_array_equal(found.normals, each[:, 0])


def test_rows_that_are_asked_for_alone():
    one, method = part(slice(10, 15), slice(None)), configure("normalnet")
    whole, last = (run(method, one, torch.device("cpu"), rows) for rows in (None, slice(3, 6)))
    np.testing.assert_array_equal(last.normals, whole.normals[int(one.mask[:3].sum()) :])
