"""The learned methods: right weights in, normals out; wrong ones are refused in one line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from photonormal.methods.engine import on_mask, run
from photonormal.methods.learned.attentionpsn import AttentionPSN, AttentionPSNConfig, AttentionPSNNet
from photonormal.methods.learned.cnnps import CNNPS, CNNPSConfig, CNNPSNet
from photonormal.methods.learned.drpsn import DRPSN, DRPSNConfig, DRPSNNet
from photonormal.methods.learned.gpsnet import GPSNet, GPSNetConfig, GPSNetMethod
from photonormal.methods.learned.lambertian_prior import LambertianPrior, LambertianPriorConfig, LambertianPriorNet
from photonormal.methods.learned.lightsnet import LightsConfig, LightsNet
from photonormal.methods.learned.lmps import LMPS, LMPSConfig, LMPSNet
from photonormal.methods.learned.normalnet import NormalNetMethod
from photonormal.methods.learned.psfcn import PSFCN, PSFCNConfig, PSFCNNet, PSFCNNormalised
from photonormal.methods.learned.sdps import SDPS
from photonormal.methods.learned.splinenet import SPLINENet, SPLINENetConfig, SPLINENetMethod
from photonormal.methods.learned.weights import checksum, load_network, weights_file
from photonormal.methods.uncalibrated.guess import guess
from photonormal.types import InputError
from tests.methods.small import small
from tests.scenes import lambertian, ring, sphere

CPU = torch.device("cpu")
SMALL = {
    LambertianPrior: ("lambertian-prior", lambda: LambertianPriorNet(LambertianPriorConfig(width=8))),
    NormalNetMethod: ("normalnet", small),
    AttentionPSN: ("attention-psn", lambda: AttentionPSNNet(AttentionPSNConfig(width=8, shallow=1, deep=1))),
    DRPSN: ("dr-psn", lambda: DRPSNNet(DRPSNConfig(width=8))),
    GPSNetMethod: ("gps-net", lambda: GPSNet(GPSNetConfig(filters=8, order=8, width=8))),
    PSFCN: ("psfcn", lambda: PSFCNNet(PSFCNConfig(width=8))),
    CNNPS: ("cnn-ps", lambda: CNNPSNet(CNNPSConfig(side=8, grown=4, hidden=8))),
    LMPS: ("lmps", lambda: LMPSNet(LMPSConfig(side=8, grown=4, hidden=8))),
    SPLINENetMethod: ("spline-net", lambda: SPLINENet(SPLINENetConfig(side=8, width=4, blocks=1, grown=4, hidden=8))),
    PSFCNNormalised: ("psfcn", lambda: PSFCNNet(PSFCNConfig(width=8, normalised=True))),
}


@pytest.fixture(params=SMALL)
def method(request, tmp_path):
    kind, make = SMALL[request.param]
    torch.manual_seed(0)
    (tmp_path / "w.safetensors").write_bytes(weights_file(kind, make(), {}))
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


def test_a_graph_needs_four_lights():
    with pytest.raises(InputError, match="3 images came but gps-net needs 4 or more lights; add photographs"):
        run(GPSNetMethod(), lambertian(sphere(24), ring(3)[:3]), CPU)


def test_missing_weights_are_refused():
    with pytest.raises(InputError, match="no weights nowhere"):
        run(PSFCN(weights="nowhere"), lambertian(sphere(24), ring(5)), CPU)


@pytest.fixture
def sdps(tmp_path):
    """SDPS-Net's two networks, random and small."""
    torch.manual_seed(0)
    nets = {"psfcn": PSFCNNet(PSFCNConfig(width=8)), "lightsnet": LightsNet(LightsConfig(width=8))}
    nets["lightsnet"].told.weight.data *= 300  # random networks tell nearly the same of all images
    for kind, net in nets.items():
        (tmp_path / f"{kind}.safetensors").write_bytes(weights_file(kind, net, {}))
    return SDPS(weights=str(tmp_path / "psfcn.safetensors"), lights=str(tmp_path / "lightsnet.safetensors"))


def test_sdps_looks_at_no_light_that_is_given(sdps):
    capture = lambertian(sphere(24), ring(8))
    given, other, none = (
        run(sdps, replace(capture, lights=L), CPU) for L in (capture.lights, capture.lights[::-1], None)
    )
    assert torch.equal(given.normals, none.normals) and torch.equal(other.normals, none.normals)
    assert none.lights is not None and none.lights.shape == capture.lights.shape


def test_sdps_measures_under_the_lights_that_its_first_network_tells(sdps):
    capture = replace(lambertian(sphere(24), ring(8)), lights=None)
    told = guess(load_network(sdps.lights_file), capture, CPU)
    found, normals = run(sdps, capture, CPU), run(PSFCN(weights=sdps.weights), told.shown_by(capture), CPU).normals
    assert torch.equal(found.lights, told.lights) and torch.equal(found.intensities, told.intensities)
    assert torch.equal(found.normals, normals)


def test_sdps_has_the_normals_network_of_psfcn():
    assert SDPS().file == PSFCN().file and SDPS(weights="mine").file == Path("mine")


def test_sdps_depends_on_both_files(sdps):
    assert sdps.weights_sha256.split() == [checksum(sdps.file), checksum(sdps.lights_file)]


def test_sdps_refuses_few_photographs(sdps):
    with pytest.raises(InputError, match="5 images came but"):
        run(sdps, lambertian(sphere(24), ring(4)), CPU)
