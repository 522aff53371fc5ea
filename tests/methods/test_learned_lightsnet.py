"""Facts about the network that tells lights: bins, order, exposure, and what its loss wants."""

import math

import pytest
import torch

from photonormal.methods.inputs.scaling import moment, scaled
from photonormal.methods.learned.lightsnet import (
    ANGLES,
    INTENSITIES,
    RANGE,
    SIDE,
    BinnedLights,
    LightsConfig,
    LightsNet,
    angles,
    between,
    direction,
    mean,
    told_wrong,
)
from photonormal.methods.learned.weights import load_network, weights_file


@pytest.fixture
def net():
    torch.manual_seed(0)
    return LightsNet(LightsConfig(width=8)).eval()


def seen(n=5, seed=0):
    images = torch.rand(2, n, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(seed))
    mask = torch.zeros(2, 1, SIDE, SIDE, dtype=torch.bool)
    mask[..., 8:-8, 8:-8] = True
    return images * mask[:, None], mask


def directions(n=200):
    g = torch.Generator().manual_seed(0)
    L = torch.randn(n, 3, generator=g)
    L[:, 2] = L[:, 2].abs() + 0.05
    return torch.nn.functional.normalize(L, dim=1)


def test_two_angles_are_a_direction():
    torch.testing.assert_close(direction(*angles(directions())), directions())


def test_a_value_is_the_mean_of_its_two_bins():
    values = torch.linspace(-1.5, 1.5, 100)
    shares = between(values, ANGLES, math.pi / 2)
    torch.testing.assert_close(shares.sum(-1), torch.ones(100))
    assert ((shares > 0).sum(-1) <= 2).all()
    found = mean(shares.clamp(min=1e-30).log(), math.pi / 2)
    torch.testing.assert_close(found, values, atol=1e-5, rtol=0)


def test_the_loss_is_least_at_the_truth():
    L, log_e = directions(24)[None], torch.linspace(-0.5, 0.5, 24)[None]
    wanted = [between(x, ANGLES, math.pi / 2) for x in angles(L)] + [between(log_e, INTENSITIES, RANGE)]
    told = BinnedLights(*(w.clamp(min=1e-30).log() for w in wanted))
    right = told_wrong(told, L, log_e)
    assert right["angle"] < 0.03 and right["intensity"] < 1e-3
    wrong = told_wrong(told, L.flip(1), log_e.flip(1))
    assert all(wrong[k] > 2 * right[k] for k in right)
    torch.testing.assert_close(told_wrong(told, L, log_e + 0.3)["intensity"], right["intensity"])  # up to one factor


def test_a_sharp_answer_is_told_as_more_certain_than_a_broad_one():
    sharp = between(torch.zeros(1, 3), ANGLES, math.pi / 2).clamp(min=1e-9).log()
    flat = torch.zeros(1, 3, ANGLES)
    e = torch.zeros(1, 3, INTENSITIES)
    assert (BinnedLights(sharp, sharp, e).told_deg < 5).all() and (BinnedLights(flat, flat, e).told_deg > 45).all()


def test_each_image_keeps_its_light_in_any_order(net):
    images, mask = seen()
    order = torch.tensor([3, 0, 4, 1, 2])
    one, other = net(images, mask), net(images[:, order], mask)
    torch.testing.assert_close(one.directions[:, order], other.directions, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(one.log_intensities[:, order], other.log_intensities, atol=1e-4, rtol=1e-4)
    assert (one.directions.norm(dim=-1) - 1).abs().max() < 1e-5 and one.log_intensities.mean(1).abs().max() < 1e-5


def test_exposure_changes_nothing(net):
    images, mask = seen()
    found = [
        net(scaled(net.scaling, x, mask, moment(net.scaling, x, mask), 5), mask).directions
        for x in (images, images * 7)
    ]
    torch.testing.assert_close(*found, atol=1e-4, rtol=1e-4)


def test_its_weights_file_builds_it_again(net, tmp_path):
    (tmp_path / "l.safetensors").write_bytes(weights_file("lightsnet", net, {}, torch.float32))
    images, mask = seen()
    again = load_network(tmp_path / "l.safetensors", "lightsnet")
    torch.testing.assert_close(net(images, mask).directions, again(images, mask).directions, atol=1e-4, rtol=1e-4)
