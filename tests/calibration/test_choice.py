"""Which of the circles around the same highlights is the sphere's."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from photonormal.calibration.choice import FoundCircle, apart, best_of, corrected
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


def test_a_few_highlights_of_other_things_do_not_outweigh_the_middle_picture():
    xy = np.array([(290.0, 200.0), (310.0, 200.0), (300.0, 190.0), (300.0, 210.0)])
    outline = replace(circle(100.0, 0.9, 0.90), xy=xy, usually=0.94)  # a third of its highlights are another thing's
    between = replace(circle(108.0, 0.5, 0.94, edges=False), xy=xy, usually=0.93)  # no highlight fits well
    survey = SimpleNamespace(shading=lambda without: np.ones((4, 30)))
    assert best_of([between, outline], survey, "here").circle.r == 100.0


@pytest.mark.parametrize("other", [{"r": 100.0, "shadows": 0.9}, {"r": 140.0, "shadows": 0.95}])
def test_circles_that_explain_less_or_lie_elsewhere_correct_nothing(other):
    cast = circle(104.0, 0.6, 0.97, edges=False)
    assert corrected(cast, [cast, circle(confidence=0.8, **other)]) == cast


def test_highlights_that_tell_where_shadows_lie_are_a_mirror_s():
    assert circle(20.0, 0.6, 0.95, mirrored=0.3).good and not circle(20.0, 0.6, 0.5, mirrored=0.3).good
