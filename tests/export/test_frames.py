"""Normals and lights in the conventions of other tools, out and back."""

import numpy as np
import pytest

from photonormal.capture.lights import read_lights
from photonormal.cli import main
from photonormal.export import load_normals, save
from photonormal.geometry import FRAMES, angle_deg, from_frame, in_frame
from photonormal.types import InputError
from tests.calibration.chrome import dome, write_chrome
from tests.scenes import lambertian, ring, sphere, write_diligent


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("ending", [".png", ".exr", ".npz"])
def test_normals_come_back_from_every_frame(tmp_path, frame, ending):
    normals = sphere()
    path = save(normals, tmp_path / f"normals{ending}", frame=frame)
    back = load_normals(path, frame)
    assert (back.mask == normals.mask).all() and angle_deg(back.map, normals.map)[normals.mask].max() < 0.01


def test_green_is_up_in_opengl_and_down_in_directx(tmp_path):
    """OpenGL: a slope that faces up is bright in green (relight's documentation); DirectX: dark."""
    import cv2

    green = {}
    for frame in FRAMES:
        path = save(sphere(), tmp_path / f"{frame}.png", frame=frame)
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        green[frame] = picture[8, 24, 1] / 65535  # near the top
    assert green["opengl"] > 0.75 and green["directx"] < 0.25 and green["y-down"] < 0.25


def test_cameras_that_look_along_z_see_normals_of_negative_z():
    """LUCES and AliceVision negate y and z of vectors that are x right, y up, z to the viewer."""
    assert in_frame(np.array([0.1, 0.2, 0.9]), "y-down").tolist() == [0.1, -0.2, -0.9]


@pytest.mark.parametrize("frame", FRAMES)
def test_calibrated_lights_come_back_from_every_frame(tmp_path, frame, capsys):
    write_chrome(tmp_path / "scene", dome(7), mask=True)
    assert main(["calibrate", str(tmp_path / "scene"), "--out", str(tmp_path / "l.lp"), "--frame", frame]) == 0
    assert angle_deg(from_frame(read_lights(tmp_path / "l.lp").vectors, frame), dome(7)).max() < 0.5


@pytest.mark.parametrize("frame", FRAMES)
def test_measuring_and_scoring_agree_on_the_frame(tmp_path, frame, capsys):
    write_diligent(tmp_path / "object", lambertian(sphere(), ring(8, 70)))
    main(["measure", str(tmp_path / "object"), "--out", str(tmp_path / "r"), "--no-mesh", "--normals-frame", frame])
    capsys.readouterr()
    assert main(["score", str(tmp_path / "object"), str(tmp_path / "r" / "normals.png"), "--frame", frame]) == 0
    assert float(capsys.readouterr().out.split()[1].rstrip(",")) < 2


def test_convert_turns_green_around(tmp_path, capsys):
    save(sphere(), tmp_path / "a.png", frame="directx")
    main(["convert", str(tmp_path / "a.png"), "--out", str(tmp_path / "b.exr"), "--from-frame", "directx"])
    assert angle_deg(load_normals(tmp_path / "b.exr").map, sphere().map)[sphere().mask].max() < 0.01


def test_an_unknown_frame_is_refused(tmp_path):
    with pytest.raises(InputError, match="no frame 'unity'; choose from opengl, directx, y-down, z-away, blender"):
        save(sphere(), tmp_path / "a.png", frame="unity")
