"""`photonormal intensities`, as a user runs it: what it writes is what the photographs are to be divided by."""

import numpy as np
import pytest

import photonormal as pn
from photonormal.cli import main
from photonormal.rig.intensities import intensities
from photonormal.types import InputError
from tests.calibration.chrome import dome, write_pictures
from tests.scenes import lambertian, sphere, write_diligent

LIGHTS = dome(9, 50.0)
GAINS = np.array([1.0, 1.4, 0.6, 0.9, 1.2, 0.5, 1.1, 0.8, 1.3])
BLACK = 0.06  # level of the sensor


@pytest.fixture
def rig(tmp_path):
    """An object under unequal lights, beside intensities that are wrong, and a board under the same lights."""
    right = lambertian(sphere(), LIGHTS, albedo=0.5)
    images = np.asarray(right.images) * GAINS[:, None, None, None].astype(np.float32) + BLACK
    write_diligent(tmp_path / "object", pn.Capture(images, right.mask, LIGHTS))
    np.savetxt(tmp_path / "object" / "light_intensities.txt", GAINS[::-1])
    board(tmp_path / "board", 0.4)
    write_pictures(tmp_path / "dark", [np.full((48, 48), round(65535 * BLACK), np.uint16)], name="dark.png")
    return tmp_path


def board(folder, white: float, order=range(9), name: str = "{:03d}.png") -> None:
    levels = 65535 * (white * GAINS * LIGHTS[:, 2] + BLACK).clip(0, 1)
    write_pictures(folder, [np.full((48, 48), round(levels[j]), np.uint16) for j in order], name=name)


def off(e: np.ndarray, true: np.ndarray = GAINS) -> float:
    """Largest relative error, up to one factor."""
    ratio = e[:, 0] / true
    return float(np.abs(ratio / ratio.mean() - 1).max())


@pytest.mark.parametrize("how", ["object", "board"])
def test_intensities_that_are_there_already_are_replaced_not_kept(rig, how):
    given = {"reference": rig / "board"} if how == "board" else {}
    out = rig / "object" / "light_intensities.txt"
    found = intensities(rig / "object", out, overwrite=True, dark=rig / "dark" / "dark.png", **given)
    assert off(found) < 0.01
    found = intensities(rig / "object", out, overwrite=True, dark=rig / "dark" / "dark.png", **given)
    assert off(found) < 0.01  # a second time
    capture = pn.load(rig / "object", dark=rig / "dark" / "dark.png")
    assert not [f for f in pn.check(capture) if f.kind == "intensities"]


def test_the_next_command_names_the_new_file_alone(rig, capsys):
    old, new = str(rig / "object" / "light_intensities.txt"), str(rig / "new.txt")
    assert main(["intensities", str(rig / "object"), "--intensities", old, "--out", new]) == 0
    assert f"--intensities {new}" in (out := capsys.readouterr().out) and old not in out


def test_a_board_is_told_by_its_names_or_its_order_for_the_pictures_that_are_used(rig):
    how = {"dark": rig / "dark" / "dark.png"}
    some = intensities(rig / "object", rig / "a.txt", rig / "board", images="3-8", **how)
    assert some.shape == (6, 1) and off(some, GAINS[2:8]) < 0.01
    board(rig / "others", 0.4, name="white {}.png")
    assert off(intensities(rig / "object", rig / "b.txt", rig / "others", **how)) < 0.01
    with pytest.raises(InputError, match="shows the board under 9 lights but there are 6 photographs"):
        intensities(rig / "object", rig / "c.txt", rig / "others", images="3-8", **how)


def test_a_white_board_tells_no_intensities(rig):
    board(rig / "white", 1.2)
    with pytest.raises(InputError, match=r"001.png of .*white is white where the board is.* expose less"):
        intensities(rig / "object", rig / "a.txt", rig / "white")
    with pytest.raises(InputError, match="shows the lights' intensities already"):
        intensities(rig / "object", rig / "a.txt", flat=rig / "board")
    assert not (rig / "a.txt").exists()
