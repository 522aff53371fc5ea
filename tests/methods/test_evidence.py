"""What a capture shows of its own faults: halves of its lights that disagree, pictures that are unlike the others."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from photonormal.geometry import fibonacci_hemisphere
from photonormal.methods.evidence import EVIDENCE, evidence_of
from photonormal.types import Capture
from tests.scenes import lambertian, sphere

CPU = torch.device("cpu")
L = fibonacci_hemisphere(60)[:30]  # those nearer to the camera


def matt() -> Capture:
    return lambertian(sphere(32), L, 0.5)


def shown(capture: Capture, name: str) -> np.ndarray:
    """A kind of evidence on the pixels that most lights reach."""
    assert capture.truth is not None
    front = capture.truth.map[capture.mask][:, 2] > 0.8
    return evidence_of(capture, capture.truth, CPU)[:, EVIDENCE.index(name)].numpy()[front]


def tilted(capture: Capture, deg: float) -> Capture:
    """Lights measured elsewhere than they were."""
    off = np.random.default_rng(0).normal(size=L.shape) * np.radians(deg)
    wrong = L + off
    return replace(capture, lights=wrong / np.linalg.norm(wrong, axis=1, keepdims=True))


@pytest.mark.parametrize("name", ["sides", "halves"])
def test_halves_of_the_lights_agree_on_a_matt_surface_and_not_under_wrong_lights(name):
    assert np.exp(shown(matt(), name)).max() < 0.11
    assert np.exp(shown(tilted(matt(), 3), name)).mean() > 0.5


def test_faulty_pictures_stand_out():
    capture = tilted(matt(), 1)
    images = np.array(capture.images)
    images[:5, :, 16:] *= 0.3  # half of each
    assert shown(replace(capture, images=images), "worst")[0] > shown(capture, "worst")[0] + 0.5


def test_bend_is_the_normals_alone():
    np.testing.assert_allclose(shown(matt(), "bend"), shown(replace(matt(), images=0.5 * matt().images), "bend"))
