"""The picture of what was found."""

import numpy as np

from photonormal.calibration.circle import Circle
from photonormal.calibration.picture import CENTRE, HEIGHT, drawn
from photonormal.calibration.reflections import Highlight
from photonormal.calibration.sphere import Sphere


def sphere(r: float) -> Sphere:
    """In a frame of 600 x 300 pixels, with two highlights."""
    highlights = tuple(Highlight(400.0 + dx * r, 100.0, 4, 1.0, 4.0, False) for dx in (-0.5, 0.5))
    return Sphere("here", Circle(400.0, 100.0, r), 0.0, highlights, np.zeros((2, 3)), np.zeros((2, 3)), (300, 600))


def crosses(picture: np.ndarray) -> tuple[float, float]:
    """From which column to which they and their numbers reach."""
    columns = np.flatnonzero((picture == CENTRE).all(-1).any(0))
    return float(columns.min()), float(columns.max())


def test_highlights_of_a_small_sphere_are_drawn_where_it_is_enlarged():
    frame = np.full((300, 600), 0.5, np.float32)
    large, small = (drawn(frame, [sphere(r)]) for r in (60.0, 6.0))
    width = 2 * HEIGHT
    assert large.shape[1] == width and small.shape[1] > 1.4 * width
    assert crosses(large)[1] - crosses(large)[0] > 100
    assert crosses(small)[0] > width and crosses(small)[1] - crosses(small)[0] > 100  # not on each other
