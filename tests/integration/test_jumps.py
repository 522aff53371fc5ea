import numpy as np
import pytest
from integrate import bini, offset_error
from solids import scene

from photonormal.integration import integrate
from photonormal.types import Normals


@pytest.mark.parametrize(("name", "size"), [("animal", 128), ("goblet", 128), ("group", 96), ("grid", 112)])
def test_jumps_are_found_at_least_as_well_as_by_the_published_equations(name, size):
    normals, z = scene(name, size)
    ours, published = (offset_error(d, z) for d in (integrate(normals, "bilateral").depth, bini(normals)))
    assert ours <= 1.02 * published


def test_the_plain_program_is_exact_on_a_plane():
    normals, _ = scene("animal", 64)
    n = np.array([0.4, -0.2, 1.0]) / np.linalg.norm([0.4, -0.2, 1.0])
    plane = Normals(normals.mask[..., None] * n, normals.mask)
    y, x = np.mgrid[:64, :64]
    assert offset_error(bini(plane), np.where(normals.mask, -0.4 * x - 0.2 * y, np.nan)) < 0.05
