"""Lights that are known badly: what is told of them, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal import InputError
from photonormal.cli import main
from photonormal.geometry import angle_deg, normalised, rotation_about_view
from photonormal.methods.uncalibrated import reduced as small_square
from photonormal.methods.uncalibrated.frame import Believed, curl, settled
from photonormal.methods.uncalibrated.limits import spread_deg
from photonormal.methods.uncalibrated.reduced import AROUND, reduced
from photonormal.methods.uncalibrated.refine import UNTOLD, mended, refined
from photonormal.methods.uncalibrated.untold import FLAT
from photonormal.scoring.lights import score_lights
from photonormal.types import Camera, Capture, Lamps, Normals
from tests.scenes import lambertian, ring, sphere, write_diligent


def scattered(n: int, seed: int = 0) -> np.ndarray:
    """Directions around the camera, up to about 45 degrees from it."""
    g = np.random.default_rng(seed)
    xy = g.uniform(-0.65, 0.65, (n, 2))
    return np.concatenate([xy, np.sqrt(1 - (xy**2).sum(1, keepdims=True))], axis=1)


def shaken(lights: np.ndarray, deg: float, seed: int = 0) -> np.ndarray:
    """Each turned by its own error, `deg` in the mean."""
    g = np.random.default_rng(seed)
    tilt = g.normal(size=lights.shape)
    tilt -= (tilt * lights).sum(1, keepdims=True) * lights
    wrong = lights + np.tan(np.radians(deg)) * tilt / np.linalg.norm(tilt, axis=1).mean()
    return wrong / np.linalg.norm(wrong, axis=1, keepdims=True)


@pytest.fixture
def true():
    return lambertian(sphere(64), scattered(40))


def bowl(x: float) -> np.ndarray:
    """A map near the identity that is no bas-relief."""
    return np.eye(3) + x * np.array([[0.5, 1.0, -0.4], [-0.6, 0.2, 0.8], [0.1, -0.2, -0.7]])


def test_random_errors_of_five_degrees_are_mended(true):
    bad = replace(true, lights=shaken(true.lights, 5))
    before, after = score_lights(bad.lights, true.lights), score_lights(refined(bad).lights, true.lights)
    assert before.mean_deg > 4.5 and after.mean_deg < 1


def test_of_a_strip_nothing_is_said():
    images = np.random.default_rng(0).uniform(size=(8, 6, 1200)).astype(np.float32)
    strip = Capture(images, lights=scattered(8))
    assert mended(strip) is None
    with pytest.raises(InputError, match="so narrow that nothing is left of it"):
        refined(strip)


def test_halfway_vectors_are_told_and_doubled(true):
    halfway = normalised(true.lights + np.array([0, 0, 1]))
    asked = replace(true, lights=shaken(halfway, 2))
    unasked = mended(asked)  # the doctor has proofs of its own
    assert unasked is None or not any("halfway" in note for note in unasked.notes)
    found = refined(asked)
    assert score_lights(found.lights, true.lights).mean_deg < 1.5 and "halfway" in found.notes[0]
    assert not refined(replace(true, lights=shaken(true.lights, 8))).notes


def test_lights_that_are_all_turned_about_the_view_axis_are_turned_back(true):
    turned = true.lights @ rotation_about_view(30).T
    found = refined(replace(true, lights=shaken(turned, 3)))
    assert score_lights(found.lights, true.lights).mean_deg < 1


def test_a_turn_is_told_by_the_normals_curl_alone(true):
    """Under turned lights a matt surface has turned normals, which explain the photographs as well."""
    turned = replace(true, lights=true.lights @ rotation_about_view(-10).T)
    assert score_lights(refined(turned).lights, true.lights).mean_deg < 1


def test_right_lights_stay_right(true):
    found = refined(true)
    assert angle_deg(found.lights, true.lights).max() < 0.5


def test_the_angles_by_which_lights_moved_are_told(true):
    bad = replace(true, lights=shaken(true.lights, 5))
    found = refined(bad)
    assert found.moved_deg is not None and found.intensities is None
    np.testing.assert_allclose(found.moved_deg, angle_deg(found.lights, bad.lights), atol=1e-6)


def test_order_of_the_images_changes_nothing(true):
    bad = replace(true, lights=shaken(true.lights, 5))
    order = np.random.default_rng(1).permutation(40)
    other = replace(bad, images=np.asarray(bad.images)[order], lights=bad.lights[order])
    assert angle_deg(refined(bad).lights[order], refined(other).lights).max() < 0.1


def test_curl_tells_a_map_that_is_no_bas_relief():
    truth, A = sphere(96, rim=0.9), bowl(0.05)
    N = torch.from_numpy(truth.map[truth.mask]) @ torch.from_numpy(np.linalg.inv(A).T).float()
    N = torch.nn.functional.normalize(N, dim=1)
    told = curl(N, torch.from_numpy(truth.mask))
    assert told is not None
    D = A.T - np.eye(3)  # what takes the normals back, to first order
    expected = [D[1, 0], D[1, 2], D[0, 1], D[0, 2], D[0, 0] - D[1, 1]]
    np.testing.assert_allclose(told.told.numpy(), expected, atol=0.02)
    assert curl(N[:5], torch.from_numpy(np.arange(96 * 96).reshape(96, 96) < 5)) is None


def test_lights_and_normals_go_back_into_the_frame_of_believed_lights():
    truth, A, L = sphere(96, rim=0.9), bowl(0.05), scattered(30)
    N = torch.from_numpy(truth.map[truth.mask]) @ torch.from_numpy(np.linalg.inv(A).T).float()
    N, s = torch.nn.functional.normalize(N, dim=1), torch.from_numpy(L @ A).float()
    told = [curl(N, torch.from_numpy(truth.mask)), None]
    found = settled(s, Believed(torch.from_numpy(L).float(), 30.0, torch.ones(30)), told)
    assert angle_deg(s.numpy(), L).mean() > 1.8
    assert angle_deg(found.numpy(), L).mean() < 0.5


def test_a_reduced_object_is_in_the_middle_and_keeps_its_radiance():
    mask = np.zeros((90, 70), bool)
    mask[10:70, 5:35] = True
    images = np.where(mask[None, ..., None], [[[[0.2]]], [[[0.4]]], [[[0.8]]]], 5.0).astype(np.float32)
    found, inside = reduced(Capture(images, mask), 32)
    assert found.shape == (3, 1, 32, 32) and inside.shape == (32, 32)
    rows, columns = np.nonzero(inside.numpy())
    assert abs(rows.mean() - 15.5) < 0.6 and abs(columns.mean() - 15.5) < 0.6
    assert abs(np.ptp(rows) + 1 - 32 / AROUND) <= 1
    for image, level in zip(found, (0.2, 0.4, 0.8), strict=True):
        np.testing.assert_allclose(image[0][inside].numpy(), level, rtol=1e-4)
        assert not image[0][~inside].any()


def test_of_a_strip_too_thin_for_the_square_nothing_is_left():
    found, inside = reduced(Capture(np.full((3, 2, 1000, 1), 0.5, np.float32)), 16)
    assert found.shape == (3, 1, 16, 16) and not inside.any() and not found.any()


def test_a_large_picture_is_reduced_some_rows_at_a_time(monkeypatch):
    y, x = np.mgrid[-1:1:310j, -1.5:1.5:470j]
    images = (2 + np.stack([x + y, x - y, np.sin(3 * x)]))[..., None].astype(np.float32)
    capture = Capture(images, x**2 / 2 + y**2 < 0.9)
    at_once, inside = reduced(capture, 32)
    monkeypatch.setattr(small_square, "DETAIL", 3)
    monkeypatch.setattr(small_square, "PIXELS", 20_000)
    found, known = reduced(capture, 32)
    assert (known != inside).sum() < 10
    assert (found - at_once)[..., known & inside].abs().max() < 0.05


def test_along_a_cylinder_lights_stay_as_they_were_given():
    y, x = np.mgrid[1 : -1 : 1j * 48, -1 : 1 : 1j * 48]
    mask = (abs(x) < 0.8) & (abs(y) < 0.8)
    map = np.stack([x, 0 * x, np.sqrt(1 - x**2 * mask)], axis=-1) * mask[..., None]
    noise = np.random.default_rng(0).normal(size=(20, 48, 48, 1)).astype(np.float32)
    capture = lambertian(Normals(map.astype(np.float32), mask), scattered(20))
    capture = replace(capture, images=np.maximum(capture.images + 0.003 * noise, 0))
    given = capture.lights * [1, 1, 0.8] + [0.1, 0, 0]  # wrong across the cylinder alone
    found = refined(replace(capture, lights=normalised(given)))
    assert np.isfinite(found.lights).all() and abs(angle_deg(found.lights, normalised(given))).mean() < 10
    assert found.notes[-1] == FLAT or "are kept" in found.notes[0]


def test_what_cannot_be_mended_is_refused(true):
    few = replace(true, images=np.asarray(true.images)[:5], lights=true.lights[:5], image_names=())
    with pytest.raises(InputError, match="5 images came but 6 or more are needed"):
        refined(few)
    with pytest.raises(InputError, match="no light directions"):
        refined(replace(true, lights=None))
    with pytest.raises(InputError, match="only distant ones"):
        refined(replace(true, lamps=Lamps(1000 * true.lights), camera=Camera(1.0)))


def test_lights_are_scored_by_angle_and_intensities_up_to_a_factor():
    L = ring(8)
    found = score_lights(L, L, np.arange(1.0, 10), 3 * np.arange(1.0, 10))
    assert found.mean_deg == 0 and found.intensity_percent == pytest.approx(0)
    assert score_lights(L, L, np.ones(9), np.array([1.1] + [1.0] * 8)).intensity_percent == pytest.approx(2.1, abs=0.5)
    assert score_lights(shaken(L, 5), L).mean_deg == pytest.approx(5, abs=0.5)
    with pytest.raises(InputError, match="9 lights came but 8 true ones"):
        score_lights(L, L[:8])


def test_measure_mends_lights_and_writes_them(true, tmp_path, capsys):
    write_diligent(tmp_path / "ball", true)
    np.savetxt(tmp_path / "ball" / "light_directions.txt", shaken(true.lights, 5))
    arguments = ["measure", str(tmp_path / "ball"), "--out", str(tmp_path / "r"), "--method", "trimmed", "--no-mesh"]
    assert main([*arguments, "--refine-lights"]) == 0
    assert "the lights moved by" in capsys.readouterr().out
    report = json.loads((tmp_path / "r" / "report.json").read_text())
    assert report["score"]["mean_deg"] < 2 and len(report["found_lights"]["moved_deg"]) == 40
    again = pn.load(tmp_path / "ball", lights=tmp_path / "r" / "lights.lp")
    assert angle_deg(again.lights, true.lights).mean() < 1.5
    assert np.allclose(again.lights, report["found_lights"]["directions"], atol=1e-5)


def test_vectors_in_a_plane_have_no_spread():
    inside = torch.tensor([[np.cos(a), 0.0, np.sin(a)] for a in np.linspace(0, 3, 9)], dtype=torch.float32)
    tilt = np.radians(5)
    off = torch.cat([inside * np.cos(tilt) + torch.tensor([0, k * np.sin(tilt), 0]) for k in (1, -1)])
    assert spread_deg(inside) < 0.05 and spread_deg(off) == pytest.approx(5, abs=0.01)


def test_where_shading_agrees_with_no_lights_it_is_said(true):
    noise = np.random.default_rng(0).uniform(0, 1, np.asarray(true.images).shape).astype(np.float32)
    found = refined(replace(true, images=noise * true.mask[..., None]))
    assert found.notes == (UNTOLD,) and not found.moved_deg.any()


def low_waves(size: int, steep: float = 0.3, seed: int = 3) -> Normals:
    """A relief of waves in all directions."""
    g = np.random.default_rng(seed)
    y, x = np.mgrid[size:0:-1, :size] * (2 * np.pi / size)
    p, q = np.zeros((2, size, size))
    for k in range(1, 12):
        a, phase = g.uniform(0, 2 * np.pi, 2)
        slope = steep / np.sqrt(12) * np.cos(k * (np.cos(a) * x + np.sin(a) * y) + phase)
        p, q = p + np.cos(a) * slope, q + np.sin(a) * slope
    return Normals(normalised(np.stack([-p, -q, np.ones_like(p)], axis=-1)).astype(np.float32), np.ones_like(p, bool))


def turn_deg(lights: np.ndarray, others: np.ndarray) -> float:
    """By how much the others are all turned together."""
    U, _, Vt = np.linalg.svd(lights.T @ others)
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    return float(np.degrees(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1))))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("steep", [0.1, 0.4])
def test_what_a_low_relief_does_not_tell_stays_as_it_was_given(steep, seed):
    """Normals turn with the lights, and noise has as much curl as a tilt of low slopes."""
    relief, L = low_waves(96, steep, seed), scattered(24, seed)
    clean = 0.4 * np.maximum(relief.map @ L.T, 0)
    noisy = clean + np.random.default_rng(seed).normal(0, 0.002, clean.shape)
    bad = shaken(L, 5, seed)
    found = refined(Capture(np.moveaxis(noisy, -1, 0).clip(0).astype(np.float32), relief.mask, bad))
    assert angle_deg(found.lights, L).mean() < 2
    assert turn_deg(found.lights, bad) < 1 + turn_deg(bad, L)


def test_right_lights_of_a_low_relief_with_a_broad_sheen_are_not_doubted():
    """A sheen bends the shading, as other lights would, which would then be unlike each other in intensity."""
    relief, L = low_waves(48), scattered(24)
    matt, shine = relief.map @ L.T, (relief.map @ normalised(L + np.array([0, 0, 1])).T).clip(0) ** 12
    for strength in (0.1, 0.15, 0.2):
        sheen = 0.4 * matt.clip(0) + strength * shine * (matt > 0)
        assert mended(Capture(np.moveaxis(sheen, -1, 0).astype(np.float32), relief.mask, L)) is None


def test_a_common_turn_is_told_unasked_by_the_curl():
    """It changes no misfit, but makes far more curl of a relief's slopes than noise does."""
    relief, L = low_waves(96, 0.4), scattered(24)
    noise = np.random.default_rng(0).normal(0, 0.002, (96, 96, 24))
    I = np.moveaxis((0.4 * np.maximum(relief.map @ L.T, 0) + noise).clip(0), -1, 0).astype(np.float32)
    assert mended(Capture(I, relief.mask, L)) is None
    better = mended(Capture(I, relief.mask, L @ rotation_about_view(8).T))
    assert better is not None and angle_deg(better.lights, L).mean() < 0.5
