"""The doctor under near lamps: a right capture is left alone, and what was done to one is found and named."""

import json
from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal.cli import main
from photonormal.doctor import findings_of
from photonormal.doctor.given import Near
from photonormal.geometry import angle_deg, normalised
from photonormal.types import Camera, Capture, Lamps, Normals
from tests.near import bump, dome, photographed
from tests.scenes import write_diligent

CAMERA = Camera(mm_per_px=1.0)
S = dome(15, 150.0, np.zeros(3))  # two widths away
NAMES = tuple(f"IMG_{j + 1}.png" for j in range(len(S)))


@pytest.fixture(scope="module")
def right() -> Capture:
    """A painted convex body with bumps, of no symmetry, 69 mm wide, under fifteen lamps around it."""
    size, half = 76, 37.5
    y, x = np.mgrid[half : -half : 1j * size, -half : half : 1j * size] / 38
    z = 0.45 * np.sqrt(np.maximum(1 - (x**2 + 1.2 * y**2) / 0.83, 0.01))
    z += 0.07 * np.sin(4 * x + 1) * np.cos(3 * y) + 0.06 * x * y
    mask = x**2 + 1.2 * y**2 < 0.81
    z_y, z_x = np.gradient(z, y[:, 0], x[0])
    map = normalised(np.stack([-z_x, -z_y, np.ones_like(z)], axis=-1)) * mask[..., None]
    X = 38 * np.stack([x, y, z - z[mask].mean()], axis=-1)
    paint = 0.5 + 0.2 * np.sin(9 * x + 2) * np.sin(7 * y) + 0.1 * (np.hypot(x - 0.2, y) < 0.2)
    shot = photographed(CAMERA, Lamps(S), X, Normals(map.astype(np.float32), mask), paint)
    noise = 0.002 * np.random.default_rng(0).standard_normal(shot.images.shape)
    images = ((shot.images + noise) * mask[..., None]).clip(0).astype(np.float32)
    return replace(shot, images=images, image_names=NAMES)


def found(capture: Capture, kind: str) -> list:
    return [f for f in findings_of(capture) if f.kind == kind]


def test_a_right_capture_is_left_alone(right):
    assert findings_of(right) == []


@pytest.mark.parametrize(
    ("kind", "change", "says"),
    [
        ("order", lambda S: S[::-1], "the reversed order fits"),
        ("order", lambda S: S[[7, *range(1, 7), 0, *range(8, 15)]], "IMG_1.png and IMG_8.png exchanged"),
        ("frame", lambda S: S * [1, -1, 1], "y is flipped"),
        ("frame", lambda S: S[:, [1, 0, 2]], "x and y are exchanged"),
        ("frame", lambda S: S * [1, 1, -1], "z of the lights is flipped"),
    ],
)
def test_wrong_positions_are_named_and_corrected_in_mm(right, kind, change, says):
    (finding,) = found(replace(right, lamps=Lamps(change(S).copy())), kind)
    assert finding.grave and says in finding.message
    assert np.abs(finding.lights - S).max() < 1e-3


def test_lamps_behind_the_object_are_named(right):
    (finding,) = found(replace(right, lamps=Lamps(S * [1, 1, -1])), "coverage")
    assert finding.grave and "15 lights lie behind the object" in finding.message


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda c: replace(c, camera=Camera(0.001)), "1000 times nearer"),
        (lambda c: replace(c, camera=Camera(0.1)), "10 times nearer"),
        (lambda c: replace(c, lamps=Lamps(25.4 * S)), "25.4 times nearer"),
        (lambda c: replace(c, lamps=Lamps(0.4 * S)), "2.5 times farther"),
        (lambda c: replace(c, lamps=Lamps(S * np.where(np.arange(15) == 3, 10, 1)[:, None])), "IMG_4.png at 1.5e+03"),
        (lambda c: replace(c, lamps=Lamps(S, axes=S, mu=np.ones(15))), "15 lamps shine away"),
    ],
)
def test_positions_of_another_scale_are_told(right, change, says):
    findings = [f for f in found(change(right), "positions") if f.grave]
    assert any(says in f.message for f in findings), findings


def test_close_and_distant_lamps_are_told(right):
    X = np.concatenate([CAMERA.flat_mm(right.mask)])
    flat = Normals(np.where(right.mask[..., None], [0, 0, 1.0], 0), right.mask)
    plane = np.zeros((*right.mask.shape, 3))
    plane[right.mask] = X
    close, far = (photographed(CAMERA, Lamps(k * S), plane, flat) for k in (0.5, 80))
    assert "only" in found(close, "positions")[0].message
    assert "as good as distant" in found(far, "positions")[0].message


def test_a_lamp_of_another_intensity_is_named_with_its_factor(right):
    images = np.array(right.images)
    images[9] *= 1.5
    (finding,) = found(replace(right, images=images), "intensities")
    assert "IMG_10.png x 1.5" in finding.message or "IMG_10.png x 1.4" in finding.message


def test_a_moved_camera_is_found_with_its_shift(right):
    images = np.array(right.images)
    images[2] = np.roll(images[2], (3, -4), axis=(0, 1))
    (finding,) = found(replace(right, images=images), "motion")
    shifts = finding.numbers["shifts_px"]
    assert list(shifts) == ["IMG_3.png"] and np.abs(np.array(shifts["IMG_3.png"]) - [-4, 3]).max() < 1


def test_a_matt_plane_is_seen_as_under_distant_lights(right):
    X = CAMERA.flat_mm(right.mask)
    n = normalised(np.array([0.2, -0.3, 1.0]))
    d = S - X[:, None]
    r = np.linalg.norm(d, axis=-1)
    I = 0.5 * (150 / r) ** 2 * ((d / r[..., None]) @ n)
    near = Near(I, X, Lamps(S))
    distant = 0.5 * near.directions() @ n
    np.testing.assert_allclose(near.seen(), np.tile(distant, (len(X), 1)), rtol=0.02)


def test_the_command_writes_corrected_positions(right, tmp_path):
    write_diligent(tmp_path / "object", replace(right, lamps=None))
    np.savetxt(tmp_path / "object" / "light_directions.txt", S * [1, -1, 1], fmt="%.8f")
    assert main(["check", str(tmp_path / "object"), "--mm-per-px", "1", "--out", str(tmp_path / "result")]) == 0
    assert json.loads((tmp_path / "result" / "report.json").read_text())["findings"][0]["kind"] == "frame"
    fixed = pn.load(tmp_path / "object", lights=tmp_path / "result" / "corrected.lp", mm_per_px=1.0)
    assert fixed.lamps is not None
    assert np.abs(fixed.lamps.positions_mm - S).max() < 1e-3
    assert angle_deg(fixed.lights, normalised(S)).max() < 1


def test_measure_warns_of_a_flipped_axis(right, tmp_path, capsys):
    write_diligent(tmp_path / "object", replace(right, lamps=None))
    np.savetxt(tmp_path / "object" / "light_directions.txt", S * [1, -1, 1], fmt="%.8f")
    how = ["--mm-per-px", "1", "--method", "woodham", "--no-mesh", "--out", str(tmp_path / "result")]
    main(["measure", str(tmp_path / "object"), *how])
    assert "y is flipped" in capsys.readouterr().err


def test_lamps_of_unequal_brightness_are_told_from_the_object(tmp_path):
    """What lamps send out comes out, not what arrives: one stands much farther away than the others."""
    X, truth = bump(CAMERA, 48)
    places = dome(15, 100.0, X.mean((0, 1))) * np.where(np.arange(15) == 5, 1.6, 1)[:, None]
    gains = np.random.default_rng(1).uniform(0.5, 1, 15)
    shot = photographed(CAMERA, Lamps(places), X, truth)
    images = shot.images * gains[:, None, None, None]
    write_diligent(tmp_path / "object", replace(shot, lamps=None, images=images / images.max()))
    np.savetxt(tmp_path / "object" / "light_directions.txt", places, fmt="%.8f")
    (tmp_path / "object" / "light_intensities.txt").unlink()
    out = tmp_path / "light_intensities.txt"
    assert main(["intensities", str(tmp_path / "object"), "--mm-per-px", "1", "--out", str(out)]) == 0
    e = np.loadtxt(out, ndmin=2)[:, 0]
    assert np.abs(np.log(e / gains * gains.mean() / e.mean())).max() < 0.1
