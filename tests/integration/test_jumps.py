import numpy as np
import pytest
from integrate import bini, offset_error, parts_error
from solids import scene

from photonormal.integration import integrate
from photonormal.integration.bilateral import Equations
from photonormal.integration.slopes import Slopes
from photonormal.types import Normals


@pytest.mark.parametrize(("name", "size"), [("animal", 128), ("goblet", 128), ("grid", 112)])
def test_jumps_are_found_at_least_as_well_as_by_the_published_equations(name, size):
    normals, z = scene(name, size)
    ours, published = (offset_error(d, z) for d in (integrate(normals, "bilateral").depth, bini(normals)))
    assert ours <= 1.02 * published


def test_parts_that_touch_at_jumps_alone_are_each_as_good_as_by_the_published_equations():
    normals, z = scene("group", 96)
    ours, published = (parts_error(d, z) for d in (integrate(normals, "bilateral").depth, bini(normals)))
    assert ours <= 1.02 * published


def test_a_narrow_rim_holds_the_outside_and_the_inside_of_a_bowl_together():
    normals, z = scene("bowl", 160, -20, -10)
    ours, published = (offset_error(d, z) for d in (integrate(normals, "bilateral").depth, bini(normals)))
    assert ours < 0.05 * published


def test_the_plain_program_is_exact_on_a_plane():
    normals, _ = scene("animal", 64)
    n = np.array([0.4, -0.2, 1.0]) / np.linalg.norm([0.4, -0.2, 1.0])
    plane = Normals(normals.mask[..., None] * n, normals.mask)
    y, x = np.mgrid[:64, :64]
    assert offset_error(bini(plane), np.where(normals.mask, -0.4 * x - 0.2 * y, np.nan)) < 0.05


def test_a_surface_is_at_rest_when_all_of_it_moves_together():
    normals, _ = scene("animal", 64)
    equations = Equations(Slopes(normals, None, 0.01), 2.0)
    z = np.zeros(equations.shape)
    bent = z.copy()
    bent[len(bent) // 2] += 0.5
    assert equations.moved(z, z + 3) < 1e-12
    assert equations.moved(z, bent + 3) == pytest.approx(equations.moved(z, bent))
    assert equations.moved(z, bent) > 1e-3
