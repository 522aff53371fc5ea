"""Which of the circles around the same highlights is the sphere's."""

import numpy as np
import pytest

from photonormal.calibration.choice import FoundCircle, apart, corrected
from photonormal.calibration.circle import Circle


def circle(
    r: float, confidence: float, shadows: float, edges: bool = True, x: float = 300.0, mirrored=1.0
) -> FoundCircle:
    c = Circle(x, 200.0, r, confidence, 0.2 if edges else 0.0)
    return FoundCircle(c, np.zeros((0, 2)), mirrored, 0.1, shadows=shadows)


def test_of_circles_alike_the_better_one_stays_and_is_as_sure_as_the_other():
    (kept,) = apart([circle(100.0, 0.8, 0.90), circle(100.5, 0.6, 0.97, edges=False)])
    assert (kept.circle.r, kept.circle.confidence, kept.shadows) == (100.5, 0.8, 0.97)
    assert len(apart([circle(100.0, 0.8, 0.90), circle(103.0, 0.6, 0.97)])) == 2


def test_edges_correct_a_circle_of_shadows():
    cast = circle(104.0, 0.6, 0.97, edges=False)
    assert corrected(cast, [cast, circle(100.0, 0.3, 0.95)]).circle.r == pytest.approx(104 - 4 / 3)
    assert corrected(circle(104.0, 0.6, 0.97), [circle(100.0, 0.6, 0.95)]).circle.r == 104.0  # it is of edges itself


@pytest.mark.parametrize("other", [{"r": 100.0, "shadows": 0.9}, {"r": 140.0, "shadows": 0.95}])
def test_circles_that_explain_less_or_lie_elsewhere_correct_nothing(other):
    cast = circle(104.0, 0.6, 0.97, edges=False)
    assert corrected(cast, [cast, circle(confidence=0.8, **other)]) == cast


def test_highlights_that_tell_where_shadows_lie_are_a_mirror_s():
    assert circle(20.0, 0.6, 0.95, mirrored=0.3).good and not circle(20.0, 0.6, 0.5, mirrored=0.3).good
