"""Facts about walks over a height field."""

import numpy as np
import pytest

from photonormal.horizon import walk


@pytest.mark.parametrize("angle", np.radians([0, 30, 45, 90, 200]))
def test_a_walk_goes_to_the_end_of_the_picture(angle):
    x, y = float(np.cos(angle)), float(np.sin(angle))
    farthest = min(63 / max(abs(x), 1e-9), 47 / max(abs(y), 1e-9))  # from a corner to the opposite edge
    steps = [distance for *_, distance in walk(x, y, (48, 64), 1.01)]
    assert steps == sorted(steps)
    assert farthest - 2 < steps[-1] < farthest + 2
