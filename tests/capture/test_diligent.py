"""DiLiGenT objects, and their true normals in MATLAB files."""

import numpy as np
import pytest
from scipy.io import savemat

from photonormal import load
from photonormal.methods import solve
from photonormal.scoring import score
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


@pytest.mark.parametrize("shape", [(5, 6, 3), (24, 24), (24, 24, 4)])
def test_normals_of_another_size(tmp_path, scene, shape):
    write_diligent(tmp_path, scene)
    savemat(tmp_path / "Normal_gt.mat", {"Normal_gt": np.zeros(shape)})
    assert str(shape) in refusal(load, tmp_path)
