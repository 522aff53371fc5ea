"""Where reflections are looked for."""

import numpy as np
import pytest

from photonormal.calibration.circle import Circle
from photonormal.calibration.mirror import directions
from photonormal.calibration.reflections import Disc
from photonormal.geometry import normalised


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.2, -0.1)])
def test_lamps_are_looked_for_where_a_ball_mirrors_what_stands_above_its_table(tilt):
    circle, T = Circle(50.0, 50.0, 40.0), normalised(np.array([*tilt, 1.0]))
    y, x = np.nonzero(circle.inside((101, 101), 0.79))
    L, _ = directions(circle, np.stack([x, y], axis=-1).astype(float))
    clear = np.abs(L @ T) > 1e-6
    assert (Disc.of(circle, (101, 101), T).inside[y, x] == (L @ T > 0))[clear].all()
