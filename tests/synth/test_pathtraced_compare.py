"""The training renderer's images are the path tracer's: the physics, checked by code that shares none of it."""

import importlib.util

import numpy as np
import pytest

from photonormal.synth.pathtraced.variant import llvm

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed"),
    pytest.mark.skipif(llvm() is None, reason="no LLVM 17 or later: one ray at a time takes minutes"),
]
COATED = np.array([0.3, 0.4, 0.6, 0, 0.6, 0.4, 0.5, 0.3, 0.5, 0.8, 0.5])
METAL = np.array([0.9, 0.7, 0.4, 1, 0.4, 0.5, 0, 0, 0, 0, 0])


@pytest.fixture(scope="module", params=[COATED, METAL], ids=["coated", "metal"])
def turtles(request):
    from photonormal.synth.pathtraced.compare import compare
    from photonormal.synth.pathtraced.objects import turtle

    return compare(turtle(), material=request.param, n=4, samples=256)  # fewer, and their noise is in the bounce


def test_a_turtle_has_the_path_tracers_direct_light_and_shadows(turtles):
    assert turtles.direct_percent() < 2
    assert turtles.shadows_percent() > 98.5


def test_a_turtle_has_the_path_tracers_bounce(turtles):
    assert turtles.bounced_percent() < 5


def test_a_drawn_solid_is_seen_as_the_path_tracer_sees_it():
    from photonormal.synth.pathtraced.compare import compare

    c = compare("blobs", seed=2, n=4, samples=32, detail=0.0, cells=160)
    assert c.normals_deg() < 0.5
    assert c.marched_percent() < 2
    assert c.direct_percent() < 2
    assert c.bounced_percent() < 5
    assert c.shadows_percent() > 98.5
