"""Tiny benchmarks of matt spheres, whose normals are known."""

import pytest

from tests.scenes import lambertian, ring, sphere, write_diligent


@pytest.fixture(scope="session")
def root(tmp_path_factory):
    """Three objects of ten in DiLiGenT's layout, twelve pictures each; bear has 24."""
    folder = tmp_path_factory.mktemp("diligent")
    for name, n in (("ball", 11), ("bear", 23), ("cat", 11)):
        write_diligent(folder / "pmsData" / f"{name}PNG", lambertian(sphere(32), ring(n, 70)))
    return folder


@pytest.fixture(scope="session")
def runs(root, tmp_path_factory):
    """Predictions of two methods from all images, and from six."""
    from photonormal.bench import bench

    out = tmp_path_factory.mktemp("stored") / "runs"
    done = bench("diligent", root, out, methods="woodham,trimmed", images="all,6", draws=3)
    assert not done.failures
    return out


@pytest.fixture(scope="session")
def pair(root, tmp_path_factory):
    """Predictions of two methods on two objects of twelve images, from all, eight and four of them."""
    from photonormal.bench import bench

    out = tmp_path_factory.mktemp("stored") / "pair"
    done = bench("diligent", root, out, methods="woodham,trimmed", images="all,4,8", draws=2, objects="ball,cat")
    assert not done.failures
    return out
