import numpy as np
import pytest

from photonormal.geometry import angle_deg, rotation_about_view
from photonormal.scoring import angular_error_deg, error_map_deg, error_picture, score
from photonormal.types import InputError, Normals
from tests.scenes import sphere


def tilted(truth: Normals, degrees: float) -> Normals:
    """The same normals, each turned by `degrees` about the x axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return Normals(truth.map @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]), truth.mask)


def test_the_truth_scores_zero():
    truth = sphere()
    result = score(truth, truth)
    assert result.mean_deg < 1e-4 and result.below_15 == result.below_30 == 100
    assert result.pixels == truth.mask.sum()


@pytest.mark.parametrize("degrees", [0.01, 1, 14.9])
def test_a_tilt_about_an_axis_never_errs_by_more_than_its_angle(degrees):
    truth = sphere()
    error = angular_error_deg(tilted(truth, degrees), truth)
    assert error.max() <= degrees * 1.001 + 1e-4
    equator = np.abs(truth.map[truth.mask][:, 0]) < 0.05  # nearly perpendicular to the axis: turned by all of it
    assert error[equator].min() > 0.998 * degrees - 1e-4


def test_small_angles_keep_their_digits():
    a = np.array([[0.0, 0.0, 1.0]], np.float32)
    b = np.array([[np.sin(np.radians(0.01)), 0, 1]], np.float32)
    assert angle_deg(a, b)[0] == pytest.approx(0.01, rel=1e-3)


def test_background_enters_no_mean():
    truth = sphere(size=64)
    half = truth.mask.copy()
    half[:, :32] = False
    estimate = Normals(tilted(truth, 10).map * half[..., None], half)
    assert score(estimate, truth).pixels == half.sum()
    assert np.isnan(error_map_deg(estimate, truth)[~half]).all()


def test_turning_both_changes_nothing():
    truth, R = sphere(), rotation_about_view(37)
    estimate = tilted(truth, 8)
    turned = score(Normals(estimate.map @ R.T, estimate.mask), Normals(truth.map @ R.T, truth.mask))
    assert turned.mean_deg == pytest.approx(score(estimate, truth).mean_deg, abs=1e-4)


def test_the_error_map_has_one_colour_for_one_error():
    truth = sphere()
    picture = error_picture(tilted(truth, 0), truth)
    assert len(np.unique(picture[truth.mask], axis=0)) == 1
    assert (picture[~truth.mask] == 255).all()


def test_other_sizes_and_no_overlap_are_refused():
    truth = sphere()
    with pytest.raises(InputError, match="both must show the same frame"):
        score(sphere(size=20), truth)
    nothing = Normals(np.zeros_like(truth.map), np.zeros_like(truth.mask))
    with pytest.raises(InputError, match="no pixel has both"):
        score(nothing, truth)
