"""The learned methods: right weights in, normals out; wrong ones are refused in one line."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from photonormal.methods.engine import on_mask, run
from photonormal.methods.learned.lambertian_prior import LambertianPrior, LambertianPriorConfig, LambertianPriorNet
from photonormal.methods.learned.normalnet import NormalNetMethod
from photonormal.methods.learned.psfcn import PSFCN, PSFCNConfig, PSFCNNet, PSFCNNormalised
from photonormal.methods.learned.weights import checksum, encoded
from photonormal.types import InputError
from tests.methods.small import small
from tests.scenes import lambertian, ring, sphere

CPU = torch.device("cpu")
SMALL = {
    LambertianPrior: ("lambertian-prior", lambda: LambertianPriorNet(LambertianPriorConfig(width=8))),
    NormalNetMethod: ("normalnet", small),
    PSFCN: ("psfcn", lambda: PSFCNNet(PSFCNConfig(width=8))),
    PSFCNNormalised: ("psfcn", lambda: PSFCNNet(PSFCNConfig(width=8, normalised=True))),
}


@pytest.fixture(params=SMALL)
def method(request, tmp_path):
    kind, make = SMALL[request.param]
    torch.manual_seed(0)
    (tmp_path / "w.safetensors").write_bytes(encoded(kind, make(), {}))
    return request.param(weights=str(tmp_path / "w.safetensors"))


def test_own_weights_measure(method):
    capture = lambertian(sphere(24), ring(5))
    normals = on_mask(run(method, capture, CPU), capture)
    assert (normals.mask == capture.mask).all()
    assert method.weights_sha256 == checksum(method.file)


def test_samples_below_zero_are_dark(method):
    """An ambient picture was subtracted: noise leaves unlit samples below zero, and one pixel in all pictures."""
    capture = lambertian(sphere(24), ring(5, 60))
    images = np.asarray(capture.images).copy()
    images[images < 0.02] = -0.05
    images[:, 12, 12] = -0.05
    below, at = (on_mask(run(method, replace(capture, images=I), CPU), capture) for I in (images, images.clip(0)))
    assert (images[:, capture.mask] < 0).any() and np.isfinite(below.map).all()
    np.testing.assert_array_equal(below.map, at.map)


def test_weights_of_another_method_are_refused(method):
    capture = lambertian(sphere(24), ring(5))
    for other in SMALL:
        if other is not type(method):
            with pytest.raises(InputError, match="are for"):
                run(other(weights=method.weights), capture, CPU)


def test_captures_without_lights_are_refused(method):
    with pytest.raises(InputError, match="no light directions"):
        run(method, replace(lambertian(sphere(24), ring(5)), lights=None), CPU)


def test_missing_weights_are_refused():
    with pytest.raises(InputError, match="no weights nowhere"):
        run(PSFCN(weights="nowhere"), lambertian(sphere(24), ring(5)), CPU)
