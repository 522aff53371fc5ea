"""Muon for matrices, Adam for what is left."""

from copy import deepcopy

import pytest
import torch
from torch import nn

from photonormal.train.optimiser import Optimiser, matrix
from photonormal.train.recipes import Recipe


def network():
    torch.manual_seed(0)
    net = nn.Sequential(nn.Conv2d(40, 48, 3), nn.Conv2d(48, 32, 1, bias=False), nn.Conv2d(32, 3, 3))
    return net.to(memory_format=torch.channels_last)


def stepped(net, optimiser, share=1.0):
    """Steps of all weights after one backward pass."""
    before = [p.detach().clone() for p in net.parameters()]
    net.zero_grad()
    net(torch.randn(2, 40, 8, 8, generator=torch.Generator().manual_seed(1))).square().sum().backward()
    optimiser.step(share)
    return [p.detach() - b for p, b in zip(net.parameters(), before, strict=True)]


def test_a_step_of_a_matrix_has_no_loud_direction():
    net = network()
    first, bias, second, last, _ = stepped(net, Optimiser(net, Recipe(lr=1e-3, muon=0.02)))
    for step in (first, second):
        values = torch.linalg.svdvals(matrix(step))[:27]  # what nine taps of three outputs can tell
        assert 0.5 * 0.02 < values.min() and values.max() < 1.3 * 0.02  # five iterations: about equal
    for step in (bias, last):  # Adam's first: every number by the rate
        torch.testing.assert_close(step.abs(), torch.full_like(step, 1e-3), rtol=1e-2, atol=0)


def test_rates_scale_together():
    a, b = network(), network()
    whole, half = stepped(a, Optimiser(a, Recipe(muon=0.02))), stepped(b, Optimiser(b, Recipe(muon=0.02)), 0.5)
    for x, y in zip(whole, half, strict=True):
        torch.testing.assert_close(y, x / 2, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("muon", [0.0, 0.02])
def test_goes_on_from_its_state(muon):
    a, b = network(), network()
    recipe = Recipe(muon=muon)
    first, second = Optimiser(a, recipe), Optimiser(b, recipe)
    stepped(a, first)
    b.load_state_dict(a.state_dict())
    second.load_state_dict(deepcopy(first.state_dict()))  # torch's share their memory
    for x, y in zip(stepped(a, first), stepped(b, second), strict=True):
        torch.testing.assert_close(x, y, rtol=0, atol=0)


def test_weights_still_move_once_the_network_was_examined():
    """Measuring with the network that learns, where it has no running mean, places it again: in the same memory."""
    net = network()
    optimiser = Optimiser(net, Recipe(muon=0.02))
    net.to("cpu", memory_format=torch.channels_last)  # as `placed` does
    assert all(step.any() for step in stepped(net, optimiser))


def test_only_what_learns_is_moved():
    net = network()
    net[0].requires_grad_(False)
    first, bias, second, *_ = stepped(net, Optimiser(net, Recipe(muon=0.02)))
    assert not first.any() and not bias.any() and second.any()
