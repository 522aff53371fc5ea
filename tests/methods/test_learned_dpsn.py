"""dpsn: a network for the lamps of one rig, in any order of the photographs; other lights are refused."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from photonormal.geometry import angle_deg, rotation_about_view
from photonormal.methods.engine import on_mask, run
from photonormal.methods.learned.dpsn import DPSN, DPSNConfig, DPSNNet
from photonormal.methods.learned.network import parameters
from photonormal.methods.learned.weights import load_network, weights_file
from photonormal.types import InputError
from tests.scenes import lambertian, ring, sphere

CPU = torch.device("cpu")
RIG = ring(5)


def as_tuples(L):
    return tuple(tuple(map(float, v)) for v in L)


@pytest.fixture
def method(tmp_path):
    torch.manual_seed(0)
    net = DPSNNet(DPSNConfig(width=16, lights=as_tuples(RIG)))
    (tmp_path / "w.safetensors").write_bytes(weights_file("dpsn", net, {}))
    return DPSN(weights=str(tmp_path / "w.safetensors"))


def test_parameters_of_the_paper_s():
    lights = as_tuples(np.random.default_rng(0).normal(size=(96, 3)))
    with torch.device("meta"):
        assert parameters(DPSNNet(DPSNConfig(lights=lights))) == 33_968_131


def test_weights_know_their_rig(method):
    assert np.allclose(load_network(method.file).config.lights, RIG)


def test_order_exposure_and_a_little_error_change_little(method):
    capture = lambertian(sphere(24), RIG)
    order = np.array([3, 0, 5, 1, 4, 2])
    found = on_mask(run(method, capture, CPU), capture)
    shuffled = replace(capture, images=3 * capture.images[order], lights=capture.lights[order])
    again = on_mask(run(method, shuffled, CPU), shuffled)
    assert (found.mask == capture.mask).all()
    assert angle_deg(found.map[found.mask], again.map[found.mask]).max() < 0.01
    off = replace(capture, lights=RIG @ rotation_about_view(1).T)
    np.testing.assert_array_equal(on_mask(run(method, off, CPU), off).map, found.map)  # it reads no directions


def test_streaming_is_the_batch(method):
    g = torch.Generator().manual_seed(0)
    net = method.network()
    images, L = torch.rand(2, 6, 1, 4, 5, generator=g), torch.from_numpy(RIG).float().expand(2, 6, 3)
    none = torch.zeros(2, 3, 4, 5)
    order = torch.tensor([4, 1, 0, 5, 2, 3])
    with torch.no_grad():
        N = net(images, L, none)
        shared = net.begin(none, L[:, order])
        parts = [net.encode(images[:, order[s]], L[:, order[s]], shared) for s in (slice(0, 2), slice(2, 6))]
        streamed = net.decode(parts[0].merged(parts[1]), 6, shared)
    torch.testing.assert_close(N.norm(dim=1), torch.ones(2, 4, 5))
    torch.testing.assert_close(N, streamed)


def test_other_lights_are_refused(method):
    for L, said in ((RIG @ rotation_about_view(8).T, r"light \d+ is \d\.\d degrees"), (RIG[:5], "5 lights came")):
        capture = lambertian(sphere(24), L)
        with pytest.raises(InputError, match=said):
            run(method, capture, CPU)
    with pytest.raises(InputError, match="0 lights came but dpsn learns for a rig"):
        DPSNConfig()
