"""Every method tells how far its normals are expected to be off, and that follows the light's facts."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal.cli import main
from photonormal.export import load_normals
from photonormal.geometry import angle_deg, fibonacci_hemisphere
from photonormal.methods import METHODS, configure, expected, parse, solve
from photonormal.methods.evidence import EVIDENCE, evidence_of
from photonormal.methods.expected import (
    Calibration,
    calibration_of,
    calibrations,
    terms,
    with_expected_error,
)
from photonormal.shading import half_vectors
from photonormal.types import Capture, Lamps
from tests.near import ORTHOGRAPHIC, PERSPECTIVE, bump, dome, photographed
from tests.scenes import lambertian, ring, sphere, write_diligent

CLASSICAL = [name for name, place in METHODS.items() if ".classical." in place]
FAST = [name for name in CLASSICAL if name not in ("table", "ward", "consensus", "monotonic")]
CPU = torch.device("cpu")


def shining(strength: float, n: int = 20, size: int = 32) -> Capture:
    """A sphere whose right half has a broad highlight of that strength."""
    truth = sphere(size)
    L = fibonacci_hemisphere(2 * n)[:n]  # those nearer to the camera
    capture = lambertian(truth, L, 0.4)
    H = half_vectors(torch.from_numpy(L)).numpy()
    glare = strength * np.einsum("hwc,nc->nhw", truth.map, H).clip(0)[..., None] ** 20
    right = (truth.map[..., 0] > 0)[..., None]
    return replace(capture, images=(np.asarray(capture.images) + glare * right).astype(np.float32))


def told(capture: Capture, method: str) -> np.ndarray:
    found = solve(capture, method, device="cpu")
    assert found.expected_error_deg is not None
    return found.expected_error_deg


UNCALIBRATED = {"irps", "sdps"}


def test_every_method_is_calibrated_but_those_that_are_known_not_to_be():
    calibrated = {parse(text)[0] for text in calibrations()}
    assert set(METHODS) - calibrated <= UNCALIBRATED and calibrated <= set(METHODS)


@pytest.mark.parametrize("method", CLASSICAL)
def test_told_on_the_mask_and_nowhere_else(method):
    capture = shining(0.5, size=12)
    capture.images[:, 5, 5:7] = 0  # no light reaches these
    found = solve(capture, method, device="cpu")
    e = found.expected_error_deg
    assert e is not None and e.dtype == np.float32
    assert np.isnan(e[~found.mask]).all()
    assert np.isfinite(e[found.mask]).all() and e[found.mask].min() > 0 and e[found.mask].max() <= 90


@pytest.mark.parametrize("method", FAST)
@pytest.mark.parametrize("images", ["noise", "white", "one lit pixel"])
def test_finite_whatever_came(method, images):
    capture = lambertian(sphere(12), fibonacci_hemisphere(6))
    I = np.zeros_like(capture.images)
    if images == "noise":
        I = np.random.default_rng(0).random(I.shape).astype(np.float32) ** 4
    elif images == "white":
        I[1:] = 1
    else:
        I[1:, 6, 6] = 0.5
    found = solve(replace(capture, images=I), method, device="cpu")
    assert found.expected_error_deg is not None and np.isfinite(found.expected_error_deg[found.mask]).all()


@pytest.mark.parametrize("n", [3, 4, 300])
def test_told_for_few_and_many_images(n):
    e = told(lambertian(sphere(12), fibonacci_hemisphere(2 * n)[:n]), "woodham")
    assert np.nanmin(e) > 0 and np.nanmax(e) <= 90


@pytest.mark.parametrize("method", FAST)
def test_shine_costs_trust_and_matt_parts_keep_it(method):
    capture = shining(0.6)
    e, m = told(capture, method), capture.truth.map
    front = capture.mask & (m[..., 2] > 0.6)
    assert np.mean(e[front & (m[..., 0] > 0.1)]) > 1.3 * np.mean(e[front & (m[..., 0] < -0.1)])


@pytest.mark.parametrize("method", ["woodham", "trimmed", "ransac", "bivariate"])
def test_told_errors_rise_with_true_ones(method):
    capture = shining(0.6)
    found = solve(capture, method, device="cpu")
    e, t = (v[capture.mask] for v in (found.expected_error_deg, angle_deg(found.map, capture.truth.map)))
    worst = t > np.quantile(t, 0.8)
    assert e[worst].mean() > 1.5 * e[~worst].mean()


@pytest.mark.parametrize("method", ["woodham", "trimmed"])
def test_exposure_and_order_change_nothing(method):
    capture = shining(0.3)
    e = told(capture, method)
    order = np.random.default_rng(0).permutation(len(capture.known_lights()))
    dim = replace(capture, images=0.5 * capture.images)
    shuffled = replace(capture, images=capture.images[order], lights=capture.known_lights()[order])
    for other in (dim, shuffled):
        np.testing.assert_allclose(told(other, method), e, rtol=0.02)


@pytest.mark.parametrize("camera", [ORTHOGRAPHIC, PERSPECTIVE], ids=["orthographic", "perspective"])
def test_near_lamps_are_evened_out_first(camera):
    X, truth = bump(camera, 32)
    near = photographed(camera, Lamps(dome(13, 64, camera.flat_mm(truth.mask).mean(0))), X, truth)
    e = told(near, "trimmed")
    as_distant = told(replace(near, lamps=None), "trimmed")
    assert np.isfinite(e).all() and e.mean() < 0.7 * as_distant.mean()


def test_blocks_of_pixels_change_nothing(monkeypatch):
    from photonormal.methods.inputs import blocks

    capture = shining(0.3)
    normals = solve(capture, "l1", device="cpu")
    whole = evidence_of(capture, normals, CPU)
    monkeypatch.setitem(blocks.BLOCK, "cpu", 1000)
    torch.testing.assert_close(evidence_of(capture, normals, CPU), whole, rtol=1e-3, atol=1e-3)
    assert whole.shape == (capture.mask.sum(), len(EVIDENCE))


def test_weights_belong_to_terms():
    F = np.zeros((1, len(EVIDENCE)))
    count = terms(F, F).shape[1]
    for method, calibration in calibrations().items():
        assert calibration.weights.shape == (len(calibration.images), count + 1), method
        assert (np.diff(calibration.curve, axis=-1) >= 0).all(), method


def test_a_calibration_at_one_number_of_images_is_taken_for_all():
    n = EVIDENCE.index("images")
    weights = np.eye(terms(np.zeros((1, len(EVIDENCE))), np.zeros((1, len(EVIDENCE)))).shape[1] + 1)[:1]  # 1 alone
    rig = Calibration(np.array([92.0]), weights, np.array([[[0.0, 2.0], [1.0, 2.0]]]))
    for images in (5, 92, 300):
        F = np.zeros((3, len(EVIDENCE)))
        F[:, n] = np.log(images)
        np.testing.assert_allclose(rig(F), np.exp(1.5))


def test_what_a_network_tells_counts():
    capture = shining(0.3, size=12)
    p = int(capture.mask.sum())
    sure, unsure = (
        with_expected_error(
            capture.truth, torch.full((p,), degrees), capture, configure("normalnet"), CPU
        ).expected_error_deg[capture.mask]
        for degrees in (1.0, 10.0)
    )
    assert unsure.mean() > 1.5 * sure.mean()


@pytest.mark.parametrize(
    "method",
    [configure("trimmed", lowest=0.6, highest=1.0), configure("normalnet", passes=1), configure("l1", steps=3)],
)
def test_a_calibration_counts_only_for_the_options_it_was_made_for(method):
    capture = shining(0.3, size=12)
    assert with_expected_error(capture.truth, None, capture, method, CPU) is capture.truth
    told_deg = torch.full((int(capture.mask.sum()),), 7.0)
    e = with_expected_error(capture.truth, told_deg, capture, method, CPU).expected_error_deg
    assert (e[capture.mask] == 7).all()  # what it says itself


def test_calibrations_hold_for_the_methods_as_they_are():
    for text in calibrations():
        name, options = parse(text)
        assert calibration_of(configure(name, **options)) is calibrations()[text], text


def test_on_large_objects_errors_are_found_on_a_grid(monkeypatch):
    capture = shining(0.5, size=64)
    whole = told(capture, "trimmed")
    monkeypatch.setattr(expected, "EVERY", 300)
    sparse = told(capture, "trimmed")
    assert (np.isfinite(sparse) == capture.mask).all()
    assert np.abs(np.log(sparse / whole))[capture.mask].mean() < 0.25


def test_of_the_largest_objects_a_networks_errors_are_found_on_a_grid(monkeypatch):
    capture = shining(0.5, size=64)
    told_deg = torch.from_numpy(1 + 5 * np.abs(capture.truth.map[capture.mask][:, 0])).float()
    method = configure("normalnet")

    def errors():
        return with_expected_error(capture.truth, told_deg, capture, method, CPU).expected_error_deg

    whole, held, evidence_of = errors(), [], expected.evidence_of
    monkeypatch.setattr(
        expected, "evidence_of", lambda *how, **more: held.append(len(F := evidence_of(*how, **more))) or F
    )
    monkeypatch.setattr(expected, "LARGEST", 300)
    sparse = errors()
    assert 100 < sum(held) <= 300 < capture.mask.sum()
    assert (np.isfinite(sparse) == capture.mask).all()
    assert np.abs(np.log(sparse / whole))[capture.mask].mean() < 0.25


def test_measured_on_the_command_line(tmp_path):
    write_diligent(tmp_path / "ball", lambertian(sphere(), ring(8, 70)))
    out = tmp_path / "result"
    assert main(["measure", str(tmp_path / "ball"), "--out", str(out), "--method", "l1", "--no-mesh"]) == 0
    normals = load_normals(out)
    assert normals.expected_error_deg is not None and np.isfinite(normals.expected_error_deg[normals.mask]).all()
    assert (out / "expected-error.png").is_file()


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("name", ["cat", "reading"])
def test_real_objects(name, data):
    """The tenth of the pixels trusted least is off by more than twice as much as the tenth trusted most."""
    capture = pn.load(data / "diligent" / "pmsData" / f"{name}PNG")
    for method in ("woodham", "ransac"):
        found = solve(capture, method, device="cpu")
        both = found.mask & capture.truth.mask
        e, t = found.expected_error_deg[both], angle_deg(found.map[both], capture.truth.map[both])
        order = np.argsort(e)
        assert t[order[-len(e) // 10 :]].mean() > 2 * t[order[: len(e) // 10]].mean()
