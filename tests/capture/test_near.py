"""Captures whose lights have a place: positions and domes in millimetres, LUCES."""

import numpy as np
import pytest

from photonormal import load
from photonormal.types import Camera, Lamps
from tests.capture.files import LIGHTS, refusal, write_folder, write_picture
from tests.near import bump, dome, photographed

HEADER = "N_img nrows ncols f x0 y0 mean_distance sfull:[Lpos Ldir Phi mu 0]\n"


def test_positions_in_a_table_and_in_an_lp(tmp_path):
    folder = write_folder(tmp_path / "a")
    np.savetxt(folder / "light_directions.txt", 400 * LIGHTS)
    (folder.parent / "b.lp").write_text(
        "4\n" + "".join(f"{j + 1}.png {x} {y} {z}\n" for j, (x, y, z) in enumerate(300 * LIGHTS))
    )
    near = load(folder, mm_per_px=0.5)
    assert near.lamps is not None
    np.testing.assert_allclose(near.lamps.positions_mm, 400 * LIGHTS)
    near = load(folder, mm_per_px=0.5, lights=folder.parent / "b.lp", images="2-4")
    assert near.lamps is not None
    np.testing.assert_allclose(near.lamps.positions_mm, 300 * LIGHTS[1:])
    assert load(folder).lamps is None
    assert any("400 long and were taken for directions" in note for note in load(folder).notes)
    assert not any("taken for directions" in note for note in load(folder, mm_per_px=0.5).notes)


def test_a_dome_is_around_the_object(tmp_path):
    folder = write_folder(tmp_path)
    flat = load(folder, mm_per_px=0.5, dome_radius_mm=250)
    far = load(folder, mm_per_px=0.5, dome_radius_mm=250, focal_px=1000)
    assert flat.lamps is not None and far.lamps is not None and far.camera is not None
    np.testing.assert_allclose(flat.lamps.positions_mm, 250 * LIGHTS, atol=1e-9)
    np.testing.assert_allclose(far.lamps.positions_mm, 250 * LIGHTS - [0, 0, 500], atol=1e-9)
    np.testing.assert_array_equal(far.camera.K, [[1000, 0, 14.5], [0, 1000, 11.5], [0, 0, 1]])


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"mm_per_px": 0.5}, "unit vectors"),
        ({"dome_radius_mm": 250}, "without --mm-per-px"),
        ({"focal_px": 900}, "without --mm-per-px"),
        ({"mm_per_px": 0.5, "dome_radius_mm": 0.5}, "in millimetres, are needed; multiply the positions by"),
        ({"mm_per_px": 0.5, "dome_radius_mm": -3}, "--dome-radius-mm is -3"),
        ({"mm_per_px": -1, "dome_radius_mm": 250}, "-1 mm wide"),
    ],
)
def test_refused(tmp_path, how, said):
    assert said in refusal(load, write_folder(tmp_path), **how)


def luces(folder, channels: int = 3, trailing: str = "", n: int = 13):
    """A hill under LEDs around the camera, as LUCES stores it; returns what was photographed."""
    K = np.array([[60.0, 0, 11], [0, 60, 12], [0, 0, 1]])
    camera = Camera(2.0, K)  # 120 mm away
    X, truth = bump(camera, 24)
    S = dome(n, 100, np.array([0, 0, -120.0]))
    axes = np.array([0, 0, -120.0]) - S
    mu = np.linspace(0.5, 1.5, n)
    shot = photographed(camera, Lamps(S, axes, mu), X, truth)
    phi = np.linspace(0.8, 1.2, n)[:, None] * np.ones((1, channels))
    white = 65535 / np.max([e.max() * image.max() for e, image in zip(phi, np.asarray(shot.images), strict=True)])
    for j in range(n):
        picture = np.rint(white * np.asarray(shot.images)[j] * phi[j]).astype(np.uint16)
        write_picture(folder / f"{j + 1:02d}.png", picture)
    rows = np.concatenate([S * [1, -1, -1], shot.lamps.axes * [1, -1, -1], phi, mu[:, None]], 1)  # type: ignore
    lines = "".join(" ".join(f"{v:.6f}" for v in row) + trailing + "\n" for row in rows)
    (folder / "led_params.txt").write_text(HEADER + f"{n} 24 24 60 11 12 120\n" + lines)
    write_picture(folder / "mask.png", truth.mask.astype(np.uint8) * 255)
    write_picture(folder / "normals.png", np.rint(65535 * (truth.map + 1) / 2).astype(np.uint16))
    return shot


@pytest.mark.parametrize(("channels", "trailing"), [(1, ""), (1, " 0 "), (3, ""), (3, " 0 ")])
def test_luces(tmp_path, channels, trailing):
    from photonormal import solve
    from photonormal.geometry import angle_deg

    shot = luces(tmp_path, channels, trailing)
    capture = load(tmp_path)
    assert capture.lamps is not None and capture.camera is not None and capture.truth is not None
    np.testing.assert_allclose(capture.lamps.positions_mm, shot.lamps.positions_mm, atol=1e-5)
    np.testing.assert_allclose(capture.lamps.axes, shot.lamps.axes, atol=1e-5)
    np.testing.assert_allclose(capture.lamps.mu, shot.lamps.mu, atol=1e-5)
    assert capture.camera.mm_per_px == pytest.approx(2)
    assert angle_deg(capture.truth.map, shot.truth.map).max() < 0.01
    assert angle_deg(solve(capture, "woodham", device="cpu").map, shot.truth.map).max() < 0.2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.replace("13 24", "12 24", 1), "says 12 LEDs but has 13 lines"),
        (lambda t: t.replace("120\n", "\n", 1), "second line"),
        (lambda t: t.replace(" 60 11", " 0 11", 1), "above 0"),
        (lambda t: HEADER, "second line"),
    ],
)
def test_led_parameters_that_can_t_be_used(tmp_path, change, said):
    luces(tmp_path)
    file = tmp_path / "led_params.txt"
    file.write_text(change(file.read_text()))
    assert said in refusal(load, tmp_path)


def test_luces_needs_its_pictures(tmp_path):
    luces(tmp_path)
    (tmp_path / "07.png").unlink()
    assert "07.png is missing" in refusal(load, tmp_path)


def test_the_doctor_does_not_take_fall_off_for_wrong_intensities(tmp_path):
    from photonormal.doctor import findings_of

    luces(tmp_path)
    assert not [f for f in findings_of(load(tmp_path)) if f.grave]


def test_measured_on_the_command_line(tmp_path):
    import json

    from photonormal.cli import main

    luces(tmp_path / "Hill")
    assert main(["measure", str(tmp_path / "Hill"), "--out", str(tmp_path / "out"), "--method", "woodham"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["light"] == "near" and not report["warnings"]
    assert report["score"]["mean_deg"] < 0.05
    depth = np.load(tmp_path / "out" / "depth.npz")["depth"]
    assert np.nanmean(depth) == pytest.approx(1)  # perspective, by the capture's own camera
