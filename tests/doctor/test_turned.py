"""Pictures that a program turned before it saved them are told, and none of what looks alike from both sides."""

import numpy as np
import pytest

from photonormal.doctor import findings_of
from photonormal.doctor.laid import Pictures
from photonormal.doctor.turned import turned, turns
from photonormal.types import Capture
from tests.doctor.test_explanations import shining
from tests.doctor.test_motion import LIGHTS, shiny
from tests.scenes import sphere

NAMES = [f"{j}.png" for j in range(len(LIGHTS))]
MIDDLE = (44.5, 44.5)


@pytest.fixture(scope="module")
def rough() -> np.ndarray:
    import cv2

    return shiny(8 * cv2.GaussianBlur(np.random.default_rng(1).standard_normal((90, 90)), (0, 0), 2.5))


@pytest.mark.parametrize(("group", "quarters"), [(slice(3, 4), 1), (slice(10, None), 3), (slice(None, None, 3), 2)])
def test_turned_pictures_are_found_with_their_turns(rough, group, quarters):
    images = rough.copy()
    images[group] = np.rot90(images[group], quarters, axes=(1, 2))
    expected = np.zeros(len(images), int)
    expected[group] = quarters
    assert (turns(Pictures.of(images)) == expected).all()
    (found,) = turned(images, MIDDLE, True, NAMES)
    assert found.grave and f"turned by {90 * quarters} degrees" in found.message


def test_pictures_that_lie_alike_are_not_turned(rough):
    y, x = np.mgrid[:90, :90].astype(float)
    for images in (rough, shiny(1.5 * np.sin(0.9 * x) * np.sin(0.9 * y))):
        assert turned(images, MIDDLE, True, NAMES) == []


def test_of_a_weave_those_that_are_turned_are_told():
    """Half a turn leaves the threads where they are, but not all of what they show."""
    y, x = np.mgrid[:90, :110].astype(float)
    images = shiny(1.5 * np.sin(0.9 * x) * np.sin(0.9 * y))
    assert turned(images, (44.5, 54.5), False, NAMES) == []
    images[::3] = np.rot90(images[::3], 2, axes=(1, 2))
    (found,) = turned(images, (44.5, 54.5), False, NAMES)
    assert list(found.numbers["turns_deg"]) == NAMES[::3]


def test_what_is_the_same_from_both_sides_says_nothing_of_half_a_turn():
    y, x = np.mgrid[:90, :110] - np.array([44.5, 54.5])[:, None, None]
    images = shiny(1.5 * np.sin(0.9 * x) * np.sin(0.9 * y))
    images[::3] = np.rot90(images[::3], 2, axes=(1, 2))
    assert turned(images, (44.5, 54.5), False, NAMES) == []


def test_turns_are_about_the_frame_s_middle(rough):
    """Of an object beside it only what also lies there once turned is compared."""
    images = rough.copy()
    images[::3] = np.rot90(images[::3], 2, axes=(1, 2))
    box = images[:, 8:, :80]
    (found,) = turned(box, (36.5, 44.5), True, NAMES)
    assert list(found.numbers["turns_deg"]) == NAMES[::3]
    assert turned(images[:, 60:], (-15.5, 44.5), True, NAMES) == []


@pytest.mark.parametrize("exponent", [5, 100])
def test_what_is_round_fits_at_any_turn(exponent):
    assert not [f for f in findings_of(shining(sphere(72), 0.3, exponent)) if f.kind in ("turned", "motion")]


def test_nothing_is_said_of_lights_where_pictures_are_turned(rough):
    images = rough.clip(0).astype(np.float32)[..., None]
    images[10:] = np.rot90(images[10:], 1, axes=(1, 2))
    found = findings_of(Capture(images / images.max(), np.ones(images.shape[1:3], bool), LIGHTS))
    assert [f.kind for f in found if f.grave] == ["turned"]
