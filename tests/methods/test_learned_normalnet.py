"""normalnet: it starts at its prior, and turning a pixel turns its normal."""

import pytest
import torch
from torch.nn import functional as F

from photonormal.methods.learned.around import Level
from photonormal.methods.learned.frame import tokens
from photonormal.methods.learned.network import parameters
from photonormal.methods.learned.normalnet import NormalNet
from tests.methods.small import small


def pixels(b=3, n=9, side=6, seed=0):
    g = torch.Generator().manual_seed(seed)
    images = torch.rand(b, n, 1, side, side, generator=g)
    lights = F.normalize(torch.randn(b, n, 3, generator=g) + torch.tensor([0, 0, 2.0]), dim=-1)
    prior = F.normalize(torch.randn(b, 3, side, side, generator=g) + torch.tensor([0, 0, 2.0])[:, None, None], dim=1)
    prior[:, 2].abs_()
    return images, lights, F.normalize(prior, dim=1)


def turned(v, degrees, axis):
    a = torch.deg2rad(torch.as_tensor(degrees))
    x, y, z = v.unbind(axis)
    return torch.stack([a.cos() * x - a.sin() * y, a.sin() * x + a.cos() * y, z], axis)


def test_size():
    assert round(parameters(NormalNet()) / 1e6, 3) == 3.649


def test_untrained_it_returns_its_prior():
    images, lights, prior = pixels()
    torch.manual_seed(0)
    N = small()(images, lights, prior)
    seen = prior[:, 2] > 0.05
    assert ((N * prior).sum(1)[seen] > 0.99).all()


def test_it_tells_how_far_it_is_off_and_learning_that_moves_no_normal():
    images, lights, prior = pixels()
    torch.manual_seed(0)
    plain = small()
    net = small(expected=True)
    net.load_state_dict(net.state_dict() | plain.state_dict())
    found = net(images, lights, prior)
    assert found.shape[1] == 4 and (found[:, 3] > 0).all() and (found[:, 3] < 91).all()
    torch.testing.assert_close(found[:, :3], plain(images, lights, prior))
    found[:, 3].sum().backward()
    learns = {k.split(".")[0] for k, p in net.named_parameters() if p.grad is not None and p.grad.abs().sum() > 0}
    assert learns == {"doubt"}


def test_what_is_added_to_trained_weights_changes_nothing_until_it_learns():
    images, lights, prior = pixels(side=8)
    torch.manual_seed(0)
    plain = small()
    net = small(memory=4, coarse=1, far=1, attention=2)
    net.load_state_dict(net.state_dict() | plain.state_dict())
    once, twice = net(images, lights, prior, passes=2).chunk(2)
    torch.testing.assert_close(once[:, :3], plain(images, lights, prior))
    torch.testing.assert_close(twice[:, :3], plain(images, lights, plain(images, lights, prior)))
    assert once.shape[1] == 3 + net.memory


def test_in_a_second_pass_an_image_is_seen_with_what_the_others_told():
    images, lights, prior = pixels()
    torch.manual_seed(0)
    net = small(memory=4)
    torch.nn.init.normal_(net.recall.weight)
    recalling = net(images, lights, prior, passes=2).chunk(2)[1]
    torch.nn.init.zeros_(net.recall.weight)
    forgetful = net(images, lights, prior, passes=2).chunk(2)[1]
    assert (recalling - forgetful)[:, :3].abs().max() > 1e-3
    torch.nn.init.normal_(net.recall.weight)
    net(images, lights, prior, passes=2).chunk(2)[1][:, :3].sum().backward()
    assert net.remember.weight.grad is not None and net.remember.weight.grad.abs().max() > 0  # the first pass's


def test_images_that_score_alike_count_alike():
    images, lights, prior = pixels()
    torch.manual_seed(0)
    net = small(attention=2)
    for p in net.score.parameters():
        torch.nn.init.zeros_(p)
    pooled = net.encode(images, lights, net.begin(prior, lights))
    torch.testing.assert_close(pooled.weighted, pooled.total)
    assert (pooled.weights == 9).all() and pooled.weights.shape[-1] == 2


def test_without_a_prior_a_pixel_faces_the_camera():
    images, lights, prior = pixels()
    N = small()(images, lights, 0 * prior)
    assert (N[:, 2] > 0.99).all()


@pytest.mark.parametrize("degrees", [37.0, 90.0, 200.0])
def test_each_pixel_turns_with_its_lights_and_prior(degrees):
    """Turning lights and prior about the view axis by any angle changes no token, so the normal turns too."""
    images, lights, prior = pixels()
    prior[:, :, 0, 0] = torch.tensor([0, 0, 1.0])  # no azimuth: nothing to turn by
    torch.manual_seed(0)
    net = small()
    torch.nn.init.normal_(net.correction.weight, std=0.1)
    l, p = turned(lights, degrees, -1), turned(prior, degrees, 1)
    a, b = (tokens(images[:, :, 0], x, net.begin(y, x)) for x, y in ((lights, prior), (l, p)))
    away = prior[:, :2].norm(dim=1) > 1e-3
    torch.testing.assert_close(a[:, away], b[:, away], atol=1e-5, rtol=0)
    with torch.no_grad():
        N, M = net(images, lights, prior), net(images, l, p)
    inside = (slice(None), slice(None), slice(4, None), slice(4, None))  # out of reach of the pixel without azimuth
    torch.testing.assert_close(turned(N, degrees, 1)[inside], M[inside], atol=1e-4, rtol=0)


@pytest.mark.parametrize("compass", [False, True])
def test_only_with_a_compass_neighbours_can_be_compared(compass):
    """Each pixel turned by an angle of its own, prior and lights: a bump may become a hollow, and all tokens stay."""
    images, lights, prior = pixels()
    degrees = 360 * torch.rand(6, 6, generator=torch.Generator().manual_seed(1))
    at = lights[..., None, None].expand(*lights.shape, 6, 6)
    torch.manual_seed(0)
    net = small(compass=compass)
    torch.nn.init.normal_(net.correction.weight, std=0.1)
    with torch.no_grad():
        N, M = net(images, at, prior), net(images, turned(at, degrees, 2), turned(prior, degrees, 1))
    apart = (turned(N, degrees, 1) - M).abs().max()
    assert apart > 0.01 if compass else apart < 1e-4


@pytest.mark.parametrize("scale", [0.1, 100.0])
def test_levelled_features_have_one_size(scale):
    x = scale * torch.randn(2, 8, 4, 4, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(Level()(x).square().mean(1), torch.ones(2, 4, 4), atol=1e-3, rtol=0)
