"""How much a surface turns within a part of its object follows from its shape alone."""

import numpy as np
import pytest

from photonormal.methods import bend
from photonormal.methods.bend import LEAST, PART, bend_deg
from photonormal.methods.between import between
from photonormal.types import Normals
from tests.scenes import sphere


@pytest.mark.parametrize("size", [48, 128, 300])
def test_a_sphere_turns_by_the_part_of_its_size_that_is_looked_at(size):
    ball = sphere(size)
    middle = ball.mask & (ball.map[..., 2] > 0.95)
    turn = np.degrees(PART * np.sqrt(np.pi))  # the root of its area is sqrt(pi) radii
    np.testing.assert_allclose(bend_deg(ball)[middle].mean(), turn, rtol=0.1)


def test_a_plane_does_not_turn():
    mask = np.zeros((40, 50), bool)
    mask[5:30, 8:40] = True
    plane = Normals(np.where(mask[..., None], (0.6, 0.0, 0.8), 0), mask)
    e = bend_deg(plane)
    assert (e[mask] == np.float32(LEAST)).all() and np.isnan(e[~mask]).all()


def test_pixels_without_neighbours_have_none():
    mask = np.zeros((9, 9), bool)
    mask[4, 4] = True
    assert bend_deg(Normals(np.where(mask[..., None], (0.0, 0.0, 1.0), 0), mask))[4, 4] == np.float32(LEAST)


def test_some_rows_and_columns_of_a_large_object_tell_the_same(monkeypatch):
    ball = sphere(128)
    whole = bend_deg(ball)
    monkeypatch.setattr(bend, "PIXELS", 4000)
    some = bend_deg(ball)
    assert (np.isfinite(some) == ball.mask).all()
    assert np.abs(np.log(some / whole))[ball.mask].mean() < 0.1


def test_values_between_those_of_a_grid_of_any_size():
    for shape in ((4, 40000), (40000, 4)):
        y, x = np.indices(shape)
        values = np.exp((x + y) / 1e4)
        found = between(values[::2, ::2], np.ones(shape, bool), 2)
        assert np.abs(found / values - 1)[:-1, :-1].max() < 1e-4
