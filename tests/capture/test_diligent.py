"""DiLiGenT objects, and their true normals in MATLAB files."""

import os
import pickle

import numpy as np
import pytest
from scipy.io import savemat

from photonormal import load
from photonormal.capture.diligent import read_mat
from photonormal.score import score
from photonormal.solve import solve
from tests.capture.files import refusal
from tests.scenes import lambertian, ring, sphere, write_diligent


@pytest.fixture
def scene():
    return lambertian(sphere(24), ring(8))


def test_an_object_comes_back(tmp_path, scene):
    write_diligent(tmp_path / "ballPNG", scene)
    intensities = np.random.default_rng(0).uniform(0.5, 2, (9, 3))
    np.savetxt(tmp_path / "ballPNG" / "light_intensities.txt", intensities)
    capture = load(tmp_path / "ballPNG")
    assert capture.name == "ball" and capture.images.shape == (9, 24, 24, 3) and capture.image_names[8] == "009.png"
    np.testing.assert_allclose(capture.known_lights(), scene.lights, atol=1e-7)
    np.testing.assert_array_equal(capture.mask, scene.mask)
    assert capture.truth is not None and scene.truth is not None
    np.testing.assert_allclose(capture.truth.map, scene.truth.map, atol=1e-6)
    for j in range(9):
        np.testing.assert_allclose(capture.images[j], scene.images[j] / intensities[j], atol=1e-5 / intensities.min())
    assert capture.saturation is not None
    np.testing.assert_allclose(capture.saturation, 1 / intensities, rtol=1e-6)


def test_measuring_from_disk_is_exact(tmp_path):
    """Lights that reach every point: least squares on 16-bit files is right to a hundredth of a degree."""
    write_diligent(tmp_path, lambertian(sphere(24, rim=0.5), ring(8)))
    capture = load(tmp_path)
    assert capture.truth is not None
    assert score(solve(capture, "woodham"), capture.truth).mean_deg < 0.01


@pytest.mark.parametrize("name", ["mask.png", "Normal_gt.mat"])
def test_what_may_be_absent(tmp_path, scene, name):
    write_diligent(tmp_path, scene)
    (tmp_path / name).unlink()
    capture = load(tmp_path)
    assert (capture.truth is None) == (name == "Normal_gt.mat")
    assert capture.mask.all() == (name == "mask.png")


@pytest.mark.parametrize("name", ["filenames.txt", "light_directions.txt", "light_intensities.txt"])
def test_what_may_not(tmp_path, scene, name):
    write_diligent(tmp_path, scene)
    (tmp_path / name).unlink()
    assert f"{name} is missing" in refusal(load, tmp_path, format="diligent")


@pytest.mark.parametrize("root", [".", "pmsData"])
def test_a_folder_of_objects_names_them(tmp_path, scene, root):
    for name in ("bearPNG", "ballPNG"):
        write_diligent(tmp_path / "pmsData" / name, scene)
    message = refusal(load, tmp_path / root)
    assert "2 objects" in message and message.index("ballPNG") < message.index("bearPNG")


def test_a_picture_that_the_list_names_is_absent(tmp_path, scene):
    write_diligent(tmp_path, scene)
    (tmp_path / "004.png").unlink()
    (tmp_path / "006.png").unlink()
    assert "004.png is missing, and 1 more" in refusal(load, tmp_path)


class TestMat:
    def test_variables_beside_it(self, tmp_path):
        savemat(tmp_path / "a.mat", {"Normal_gt": np.ones((2, 3, 3)), "cells": np.array(["a", 3], object)})
        np.testing.assert_array_equal(read_mat(tmp_path / "a.mat"), np.ones((2, 3, 3)))

    @pytest.mark.parametrize(
        "content",
        [
            {"other": np.ones((2, 3, 3))},
            {"Normal_gt": np.ones((2, 3))},
            {"Normal_gt": np.ones((2, 3, 4))},
            {"Normal_gt": "text"},
            {"Normal_gt": np.array(["a", 3], object)},
            {"Normal_gt": {"field": 1}},
            {"Normal_gt": np.ones((2, 3, 3)) * 1j},
        ],
        ids=lambda c: next(iter(c)) + type(next(iter(c.values()))).__name__,
    )
    def test_other_contents(self, tmp_path, content):
        savemat(tmp_path / "a.mat", content)
        assert "needed" in refusal(read_mat, tmp_path / "a.mat")

    @pytest.mark.parametrize("compressed", [True, False])
    def test_truncated_and_damaged(self, tmp_path, compressed):
        map = np.random.default_rng(0).normal(size=(9, 9, 3))
        savemat(tmp_path / "a.mat", {"Normal_gt": map}, do_compression=compressed)
        data = (tmp_path / "a.mat").read_bytes()
        for left in (0, 4, 100, 127, 130, 150, 200, len(data) // 2, len(data) - 1):
            (tmp_path / "a.mat").write_bytes(data[:left])
            assert "a.mat" in refusal(read_mat, tmp_path / "a.mat")
        rng = np.random.default_rng(1)
        for _ in range(50):
            damaged = bytearray(data)
            damaged[rng.integers(124, 200)] = rng.integers(256)
            (tmp_path / "a.mat").write_bytes(damaged)
            try:
                read_mat(tmp_path / "a.mat")
            except Exception as error:
                refusal(_again, error)

    @pytest.mark.parametrize(
        "data", [b"", b"junk", b"MATLAB 7.3 MAT-file" + bytes(105) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n"]
    )
    def test_other_files(self, tmp_path, data):
        (tmp_path / "a.mat").write_bytes(data)
        assert "a.mat" in refusal(read_mat, tmp_path / "a.mat")

    def test_a_pickle_is_never_opened(self, tmp_path):
        class Bomb:
            def __reduce__(self):
                return os.mkdir, (str(tmp_path / "trace"),)

        (tmp_path / "a.mat").write_bytes(pickle.dumps(Bomb()))
        refusal(read_mat, tmp_path / "a.mat")
        assert not (tmp_path / "trace").exists()

    def test_a_size_unlike_the_pictures(self, tmp_path, scene):
        write_diligent(tmp_path, scene)
        savemat(tmp_path / "Normal_gt.mat", {"Normal_gt": np.zeros((5, 6, 3))})
        assert "true normals are (5, 6, 3)" in refusal(load, tmp_path)


def _again(error):
    raise error
