"""What is made of large frames, and results from Python."""

import json

import numpy as np
import pytest

import photonormal as pn
from photonormal.export.result import photograph
from photonormal.types import Capture, InputError, Normals, Result
from tests.scenes import lambertian, ring, sphere


def test_of_a_large_frame_the_photograph_is_shown_by_means():
    h, w = 3000, 50
    image = np.random.default_rng(0).random((3, h, w, 3)).astype(np.float32)
    mask = np.ones((h, w), bool)
    normals = Normals(np.broadcast_to(np.float32([0, 0, 1]), (h, w, 3)).copy(), mask)
    result = Result(
        Capture(image, mask, np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8]])),
        normals,
        None,
        None,
        None,
        None,
        {},
    )
    shown = photograph(result, np.s_[4:h, 1:w])
    np.testing.assert_allclose(shown[0, 0], image[0, 4:7, 1:4].mean((0, 1)), rtol=1e-5)
    np.testing.assert_allclose(shown[700, 3], image[0, 2104:2107, 10:13].mean((0, 1)), rtol=1e-5)
    assert shown.shape == (999, 17, 3)
    small = photograph(result, np.s_[0:900, 0:w])
    assert np.array_equal(small, image[0, :900])


def test_a_measurement_is_saved_as_the_command_writes_it(tmp_path):
    capture = lambertian(sphere(24), ring(6, 60))
    result = pn.measure(capture, "woodham", expected_error=False, examine=False)
    assert pn.save(result, tmp_path / "result") == tmp_path / "result"
    np.testing.assert_array_equal(pn.load_normals(tmp_path / "result" / "normals.npz").map, result.normals.map)
    assert json.loads((tmp_path / "result" / "report.json").read_text())["method"] == "woodham"
    pn.save(result, tmp_path / "result")  # replaces its own
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    with pytest.raises(InputError, match="mine"):
        pn.save(result, tmp_path / "mine")
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["notes.txt"]
