"""Pictures that are brighter or darker than their lights say: divided by that where shading is certain of it."""

from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal.geometry import normalised
from photonormal.methods import configure
from photonormal.methods.engine import prepared
from photonormal.types import Capture
from tests.scenes import lambertian, ring, sphere

LIGHTS = np.concatenate([ring(8, 35), ring(6, 60)[:6]])  # 15, one along the view axis
WRONG = np.where(np.isin(np.arange(15), [2, 7, 11]), [1, 1, 1.3, 1, 1, 1, 1, 0.8, 1, 1, 1, 1.2, 1, 1, 1], 1.0)


EVEN = np.ones(15)


def photographed(factor: np.ndarray = EVEN, gloss: float = 0.0) -> pn.Capture:
    """A sphere under lights of those factors, with some noise."""
    capture = lambertian(sphere(64), LIGHTS)
    half = normalised(LIGHTS + np.array([0, 0, 1]))
    shine = gloss * np.maximum(capture.truth.map @ half.T, 0) ** 40  # (h, w, n)
    I = np.asarray(capture.images) + np.moveaxis(shine, -1, 0)[..., None] * (np.asarray(capture.images) > 0)
    noise = 1 + 0.01 * np.random.default_rng(0).standard_normal(I.shape)
    return replace(capture, images=(I * noise * factor[:, None, None, None]).astype(np.float32))


NORMALNET = configure("normalnet")


def evened(capture: Capture) -> Capture:
    return prepared(NORMALNET, capture)


def in_memory(capture: pn.Capture) -> np.ndarray:
    return np.stack([capture.images[j] for j in range(len(capture.lights))])


@pytest.mark.parametrize("gloss", [0, 0.5])
def test_pictures_become_those_of_even_lights(gloss):
    right, wrong = photographed(gloss=gloss), photographed(WRONG, gloss)
    assert evened(right) is right
    mended = evened(wrong)
    ratio = in_memory(mended)[:, right.mask].sum((1, 2)) / in_memory(right)[:, right.mask].sum((1, 2))
    assert np.allclose(ratio / np.median(ratio), 1, atol=0.01 + 0.04 * gloss)
    (note,) = mended.notes
    assert note.startswith("3 pictures are brighter or darker than") and note.endswith("each was divided by that.")


def test_what_brightens_a_part_of_a_picture_is_no_light():
    capture = photographed()
    I = in_memory(capture)
    I[4, :, :30] *= 1.5
    I[9, 30:] *= 0.6
    half = replace(capture, images=I)
    assert evened(half) is half


def test_where_most_lights_are_off_something_else_is_wrong():
    doubtful = photographed(np.exp(np.random.default_rng(1).normal(0, 0.3, 15)))
    assert evened(doubtful) is doubtful


def test_few_lights_tell_nothing():
    capture = photographed(WRONG)
    few = pn.Capture(in_memory(capture)[:7], capture.mask, LIGHTS[:7])
    assert evened(few) is few


def test_normalnet_measures_better_for_it_and_says_so():
    right, wrong = photographed(), photographed(WRONG)
    error = [
        pn.score(pn.solve(capture, "normalnet", even=even), right.truth).mean_deg
        for capture, even in ((right, True), (wrong, True), (wrong, False))
    ]
    assert error[1] < 1.1 * error[0] and error[1] < 0.7 * error[2]
    told = pn.measure(wrong, integration=None, albedo=False, expected_error=False, examine=False)
    assert any("divided by that" in warning for warning in told.report["warnings"])


def test_other_methods_see_what_was_photographed():
    wrong = photographed(WRONG)
    assert prepared(configure("woodham"), wrong) is wrong
