"""Maps of materials: what is not told is what the nearest pixel tells."""

import numpy as np

from photonormal.export.materials import spread


def test_what_is_unknown_is_taken_from_the_nearest_pixel():
    random = np.random.default_rng(0)
    known = random.random((300, 40)) < 0.01
    one, other = (random.integers(0, 256, known.shape, np.uint8) for _ in range(2))
    before = one.copy(), other.copy()
    spread(known, one, other)
    places = np.argwhere(known)
    for row, column in random.integers(0, known.shape, (200, 2)):
        away = np.linalg.norm(places - (row, column), axis=1)
        near = places[away <= 1.05 * away.min()]  # OpenCV's distances are within 2 %
        pairs = {(before[0][y, x], before[1][y, x]) for y, x in near}
        assert (one[row, column], other[row, column]) in pairs


def test_where_nothing_is_known_nothing_is_changed():
    picture = np.full((5, 6), 255, np.uint8)
    spread(np.zeros((5, 6), bool), picture)
    assert (picture == 255).all()
