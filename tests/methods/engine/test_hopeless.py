"""What no method can measure: `solve` and `measure` say the same of it, in one line."""

from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from tests.scenes import lambertian, ring, sphere

BALL = lambertian(sphere(24), ring(6))


@pytest.mark.parametrize("command", [pn.solve, pn.measure])
@pytest.mark.parametrize(
    ("capture", "said"),
    [
        (replace(BALL, lights=BALL.lights * [1, 1, -1]), "all 7 lights of sphere lie behind the object"),
        (replace(BALL, images=np.repeat(BALL.images[2:3], 7, axis=0)), "all 7 pictures of sphere show the same"),
        (replace(BALL, images=np.full_like(BALL.images, 0.5)), "all 7 pictures of sphere show the same"),
        (replace(BALL, images=np.zeros_like(BALL.images)), "inside the mask are dark"),
    ],
)
def test_it_is_refused(command, capture, said):
    with pytest.raises(pn.InputError, match=said) as told:
        command(capture, "woodham")
    assert "\n" not in str(told.value)


class OneByOne:
    """Pictures that are read one at a time."""

    def __init__(self, images):
        self.images, self.shape = images, images.shape

    def __getitem__(self, j):
        return self.images[j]


@pytest.mark.parametrize(
    ("method", "how"), [("woodham", "given"), ("woodham", "unknown"), ("woodham", "refined"), ("sdps", "given")]
)
def test_pictures_in_a_unit_whose_squares_overflow(method, how):
    huge = replace(BALL, images=OneByOne(BALL.images * np.float32(1e20)))
    with pytest.raises(pn.InputError, match=r"reach .*e\+\d+ but single precision needs 1e\+12 or less"):
        pn.measure(huge, method, lights=how)


@pytest.mark.parametrize("behind", [1, 6])
def test_where_some_lights_lie_behind_the_object_check_and_measure_say_so(behind):
    lights = BALL.known_lights().copy()
    lights[:behind, 2] *= -1
    capture = replace(BALL, lights=lights)
    (told,) = [finding.message for finding in pn.check(capture) if "behind the object" in finding.message]
    assert told.startswith(f"{behind} light") and told in pn.measure(capture, "woodham").report["warnings"]


def test_one_picture_that_differs_is_enough_to_go_on():
    """However little it is: then normals are wrong, but the photographs say why (`photonormal.check`)."""
    images = np.full_like(BALL.images, 0.5)
    images[3] *= 0.999
    assert pn.solve(replace(BALL, images=images), "woodham").mask.any()
