"""A white board photographed under each light takes its fall-off and its brightness out of the object's pictures."""

import cv2
import numpy as np
import pytest

import photonormal as pn
from photonormal.geometry import angle_deg, normalised
from photonormal.types import InputError
from tests.calibration.chrome import dome

SIZE, WIDTHS = 40, 2.0
LIGHTS = dome(9, 45.0)
GAINS = np.linspace(0.6, 1.2, len(LIGHTS))
Y, X = np.mgrid[0.5 : -0.5 : 1j * SIZE, -0.5 : 0.5 : 1j * SIZE]


def shown(normals: np.ndarray) -> np.ndarray:
    """Pictures (n, h, w) of a flat white thing under lamps of several brightnesses two of its widths away."""
    d = WIDTHS * LIGHTS[:, None, None] - np.stack([X, Y, np.zeros_like(X)], axis=-1)
    r = np.linalg.norm(d, axis=-1)
    return 0.4 * GAINS[:, None, None] * (WIDTHS / r) ** 2 * ((d / r[..., None]) * normals).sum(-1).clip(0)


def write(folder, pictures: np.ndarray, name: str) -> None:
    folder.mkdir()
    for j, picture in enumerate(pictures):
        cv2.imencode(".png", np.rint(65535 * picture.clip(0, 1)).astype(np.uint16))[1].tofile(
            folder / name.format(j + 1)
        )


@pytest.fixture
def folder(tmp_path):
    slope = np.stack([0.1 * np.sin(12 * X), 0.1 * np.cos(9 * Y), np.ones_like(X)], axis=-1)
    write(tmp_path / "object", shown(normalised(slope)), "IMG_{}.png")
    np.savetxt(tmp_path / "object" / "light_directions.txt", LIGHTS)
    return tmp_path


def error_deg(capture) -> float:
    truth = normalised(np.stack([0.1 * np.sin(12 * X), 0.1 * np.cos(9 * Y), np.ones_like(X)], axis=-1))
    return float(angle_deg(pn.solve(capture, "woodham").map, truth).mean())


@pytest.mark.parametrize("name", ["IMG_{}.png", "white{}.png"])
def test_fall_off_and_intensities_come_out_in_one(folder, name):
    write(folder / "white", shown(np.array([0, 0, 1.0])), name)
    assert error_deg(pn.load(folder / "object")) > 8
    assert error_deg(pn.load(folder / "object", flat=folder / "white")) < 1.5


def test_a_subset_takes_its_own_boards(folder):
    write(folder / "white", shown(np.array([0, 0, 1.0])), "white{}.png")
    assert error_deg(pn.load(folder / "object", flat=folder / "white", images="3-9")) < 1.5


def test_boards_that_do_not_fit_are_refused(folder):
    write(folder / "bright", 4 * shown(np.array([0, 0, 1.0])), "white{}.png")
    with pytest.raises(InputError, match=r"of the flat field .* is white"):
        pn.load(folder / "object", flat=folder / "bright")
    write(folder / "white", shown(np.array([0, 0, 1.0]))[:5], "white{}.png")
    with pytest.raises(InputError, match="has 5 pictures but one of a white board for each of 9 lights"):
        pn.load(folder / "object", flat=folder / "white")
    with pytest.raises(InputError, match="leave --flat or --mm-per-px out"):
        pn.load(folder / "object", flat=folder / "white", mm_per_px=1.0)
