"""A bowl's inner side gets the same light from the rest of it everywhere, which is known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal.geometry import fibonacci_hemisphere
from photonormal.materials import interreflections
from photonormal.materials.exchange import form_factors, shadows
from photonormal.materials.interreflections import brightening
from photonormal.methods.albedo import lambertian_albedo
from photonormal.types import Capture, Normals, Surface
from tests.scenes import lambertian, sphere

L = fibonacci_hemisphere(40)
L = L[L[:, 2] > 0.25]
ALBEDO = np.array([0.8, 0.5, 0.2])
HALF = 0.9  # of the frame that the bowl's rim takes


def bowl(size=48, share=0.45, exposure=1.0, ambient=0.0, bounces=True, albedo=ALBEDO):
    """A spherical bowl, `share` of a sphere, in a plate; its depth and where it lies.

    The form factor between any two points of a sphere is the same, so that each point of the bowl gets
    share * mean(B), and mean(B) = albedo (mean(s) + share * mean(B)).
    """
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size] / HALF  # the rim's radius is 1
    depth = 2 * share / np.sqrt(4 * share * (1 - share))  # of the bowl: share = depth / (2 R), 1 = depth (2 R - depth)
    R = depth / (2 * share)
    inside = np.hypot(x, y) < 1
    lower = np.sqrt(np.maximum(R**2 - x**2 - y**2, 0))
    z = np.where(inside, (R - depth) - lower, 0.0)
    N = np.where(inside[..., None], np.stack([-x, -y, lower], -1) / R, [0.0, 0.0, 1.0])
    P = np.stack([x, y, -lower], -1)  # from the sphere's middle
    cos = N @ L.T  # (h, w, n)
    leaves = P[..., None, 2] - 2 * (P @ L.T) * L[:, 2]  # z where the way to the light leaves the sphere
    s = cos.clip(0) * (~inside[..., None] | (leaves > -(R - depth)))
    mean = L[:, 2] / (2 * R * depth)  # light through the rim over the bowl's area
    G = share * albedo * mean[:, None] / (1 - share * albedo) * inside[..., None, None] * bounces  # (h, w, n, c)
    I = exposure * albedo * (s[..., None] + G + ambient * (1 - share * inside)[..., None, None])
    mask = np.ones((size, size), bool)
    capture = Capture(np.moveaxis(I, 2, 0).astype(np.float32), mask, L, Normals(N.astype(np.float32), mask))
    well = np.hypot(x, y) < 0.85
    return capture, Surface(z * HALF * (size - 1) / 2, mask), well


def corrected(capture, surface, normals=None):
    normals = normals or capture.truth
    albedo = lambertian_albedo(capture, normals)
    found = brightening(capture, normals, surface, albedo)
    before = albedo.copy()
    if found is not None:
        found.take_from(albedo)
    return found, before, albedo


@pytest.mark.parametrize("exposure", [1.0, 0.4, 65535.0])
@pytest.mark.parametrize("ambient", [0.0, 0.015])
def test_a_bowl_has_one_albedo_and_its_shadows_tell_the_exposure(exposure, ambient):
    capture, surface, well = bowl(exposure=exposure, ambient=ambient)
    found, before, after = corrected(capture, surface)
    assert np.abs(found.exposure * exposure - 1).max() < 0.12
    plate = before[0, 0]
    assert np.median(before[well][:, 0]) > 1.15 * plate[0]
    assert np.abs(np.median(after[well], axis=0) / plate - 1).max() < 0.025
    assert np.abs(after[0, 0] / plate - 1).max() < 0.005
    assert found.as_dict()["most_percent"] > 13
    assert np.allclose(found.as_dict()["exposure"], found.exposure, rtol=1e-3)


def test_where_shadows_are_black_nothing_is_taken_out():
    capture, surface, _ = bowl(bounces=False)
    assert corrected(capture, surface)[0] is None


def test_a_sphere_sends_itself_no_light():
    truth = sphere()
    size = len(truth.mask)
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size]
    height = np.sqrt(np.maximum(1 - x**2 - y**2, 0)) * size / 2
    assert corrected(lambertian(truth, L), Surface(height, truth.mask))[0] is None


def test_light_of_one_sign_in_all_shadows_is_no_light_between_parts():
    capture, surface, _ = bowl(bounces=False, ambient=0.05)
    assert corrected(capture, surface)[0] is None


def test_a_grey_capture_is_corrected_as_one_channel():
    capture, surface, well = bowl()
    grey = replace(capture, images=np.ascontiguousarray(np.asarray(capture.images)[..., :1]))
    _, _, coloured = corrected(capture, surface)
    found, _, after = corrected(grey, surface)
    assert found.logs.shape[2] == 1
    assert np.abs(np.median(after[well][:, 0]) / np.median(coloured[well][:, 0]) - 1) < 0.01


@pytest.mark.parametrize("share", [0.2, 0.45])
def test_form_factors_in_a_bowl_add_up_to_its_share_of_the_sphere(share):
    capture, surface, well = bowl(share=share)
    parts = np.ones(well.shape, int)
    F = form_factors(surface.depth, capture.truth.map, parts)
    total = np.asarray(F.sum(1)).reshape(well.shape)
    assert np.abs(total[well] - share).max() < 0.06
    assert total[0].max() < 0.01
    parts[:, 24:] = 2  # of one half the depth of the other is not known
    assert not form_factors(surface.depth, capture.truth.map, parts)[parts.ravel() == 1][:, parts.ravel() == 2].nnz


def test_a_wall_shades_its_own_part_alone():
    height, low = np.zeros((1, 20)), np.array([[0.8, 0, 0.6]])  # light from the right: shadows go to the left
    height[0, 12] = 6.0
    parts = np.ones((1, 20), int)
    assert shadows(height, parts, low)[:, 0].nonzero()[0].tolist() == [5, 6, 7, 8, 9, 10, 11]
    parts[0, :8], parts[0, 8] = 2, 0  # what stands beside it has a height of its own
    assert shadows(height, parts, low)[:, 0].nonzero()[0].tolist() == [8, 9, 10]  # pixels 9 to 11


def test_reading_some_rows_at_a_time_changes_nothing(monkeypatch):
    capture, surface, _ = bowl(size=80)
    whole = corrected(capture, surface)[0]
    monkeypatch.setattr(interreflections, "PIXELS", 300)
    assert np.array_equal(corrected(capture, surface)[0].logs, whole.logs)


def test_measure_takes_it_out_and_says_so():
    capture, _, well = bowl(share=0.2)
    result = pn.measure(capture, "trimmed", expected_error=False, examine=False)
    assert result.report["interreflections"]["most_percent"] > 5
    flat = pn.measure(capture, "trimmed", expected_error=False, examine=False, integration=None)
    assert "interreflections" not in flat.report
    assert np.median(result.albedo[well]) < 0.97 * np.median(flat.albedo[well])
