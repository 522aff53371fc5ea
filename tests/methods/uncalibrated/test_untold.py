"""Surfaces that leave lights open, and one that doesn't."""

import numpy as np
import pytest
import torch

from photonormal.methods.uncalibrated.untold import (
    BULGE,
    FLAT,
    HOLLOW,
    REGULAR,
    leaning,
    off_by,
    shape_of_lights,
    side_of_lights,
)

SIZE = 64
X, Y = np.meshgrid(np.linspace(-1, 1, SIZE), np.linspace(1, -1, SIZE))
SQUARE = np.maximum(abs(X), abs(Y)) < 0.9
ROUND = np.hypot(X, Y) < 0.9
SURFACES = {  # slopes dz/dx and dz/dy, and the mask
    "plane": (0 * X, 0 * Y, SQUARE),
    "cylinder": (-X / np.sqrt(1.1 - X**2), 0 * Y, SQUARE),
    "saddle": (X, -Y, SQUARE),
    "pyramid": (-0.6 * np.sign(X) * (abs(X) > abs(Y)), -0.6 * np.sign(Y) * (abs(Y) >= abs(X)), SQUARE),
    "sphere": (*(-v / np.sqrt(np.clip(0.82 - X**2 - Y**2, 1e-3, None)) for v in (X, Y)), ROUND),
    "waves": (np.sin(9 * X + 4 * Y**2), np.cos(8 * Y - 3 * X * Y), SQUARE),
}


def surface(name):
    p, q, mask = SURFACES[name]
    N = np.stack([-p, -q, np.ones_like(p)], axis=-1)[mask]
    return torch.from_numpy(N / np.linalg.norm(N, axis=1, keepdims=True)).float(), torch.from_numpy(mask)


@pytest.mark.parametrize(
    ("name", "left_open"),
    [
        ("plane", (FLAT,)),
        ("cylinder", (FLAT,)),
        ("saddle", (REGULAR,)),
        ("pyramid", (REGULAR,)),
        ("sphere", ()),
        ("waves", ()),
    ],
)
def test_a_regular_surface_leaves_lights_open(name, left_open):
    assert shape_of_lights(*surface(name)) == left_open


def test_only_an_outline_where_the_surface_turns_away_tells_a_bulge_from_a_hollow():
    assert side_of_lights(leaning(*surface("sphere"))) == (BULGE,)
    assert side_of_lights(leaning(*surface("waves"))) == (HOLLOW,)
    N, inside = surface("sphere")
    assert side_of_lights(leaning(N * torch.tensor([-1.0, -1.0, 1.0]), inside)) == (HOLLOW,)


def test_how_far_lights_are_off_is_told_of_objects_seen_whole_alone():
    assert "about 2 degrees off" in off_by(2.0, leaning(*surface("sphere")))
    assert "is not known" in off_by(2.0, leaning(*surface("waves")))
    N, inside = surface("sphere")
    cap = inside & torch.from_numpy(np.hypot(X, Y) < 0.5)  # a dome whose rim still faces the camera
    assert "is not known" in off_by(2.0, leaning(N[cap[inside]], cap))
