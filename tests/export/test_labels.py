"""Pictures for people say what they show, and leave what they show as it is."""

import numpy as np
import pytest

from photonormal.export.labels import NARROWEST, labelled, with_scale
from photonormal.scoring import SCALE_DEG, colours


@pytest.mark.parametrize("size", [(30, 40), (300, 500), (2500, 3000)])
def test_a_scale_lies_below_the_picture(size):
    picture = colours(np.full(size, 10.0))
    rows, (h, w) = with_scale(lambda some: picture[some], *size)
    shown = np.concatenate([rows(slice(top, top + 17)) for top in range(0, h, 17)])
    assert shown.shape == (h, w, 3) and w == max(size[1], NARROWEST) and h > size[0]
    np.testing.assert_array_equal(shown[: size[0], : size[1]], picture)
    bar = shown[size[0] + 6]
    ends = colours(np.array([[0.0, SCALE_DEG]]))[0]
    assert (bar[0] == ends[0]).all() and (bar[-1] == ends[1]).all()
    assert (shown[size[0] + 20 :].min(-1) < 128).any()  # numbers


@pytest.mark.parametrize("width", [20, 400])
def test_a_label_fits_its_picture(width):
    picture = np.full((50, width, 3), 7, np.uint8)
    shown = labelled(picture, "error, 0 to 45 deg")
    np.testing.assert_array_equal(shown[-50:], picture)
    written = (shown[:-50].min(-1) < 200).any(0)
    assert written.any() and not written[-1]
