"""Facts about the networks themselves: sizes, lengths, reach, pooling."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.polynomial.chebyshev import chebval

from photonormal.methods.inputs.maps import about_view
from photonormal.methods.inputs.scaling import moment, scaled
from photonormal.methods.learned.attentionpsn import AttentionPSNConfig, AttentionPSNNet
from photonormal.methods.learned.cnnps import CNNPSConfig, CNNPSNet
from photonormal.methods.learned.drpsn import DRPSNConfig, DRPSNNet
from photonormal.methods.learned.gpsnet import Filters, GPSNet, GPSNetConfig
from photonormal.methods.learned.lambertian_prior import LambertianPriorConfig, LambertianPriorNet
from photonormal.methods.learned.layers import unit
from photonormal.methods.learned.lmps import LMPSConfig, LMPSNet
from photonormal.methods.learned.network import parameters
from photonormal.methods.learned.pooling import Pooled, pool, weighted_sum
from photonormal.methods.learned.psfcn import PSFCNConfig, PSFCNNet
from photonormal.methods.learned.splinenet import SPLINENet, SPLINENetConfig
from photonormal.types import InputError
from tests.methods.small import small, starting_at_zero

PAPER = LambertianPriorConfig()
SMALL = replace(PAPER, width=8)
VARIANTS = [
    SMALL,
    replace(SMALL, exchange=False),
    replace(SMALL, prior=""),
    replace(SMALL, branches=1),
    replace(SMALL, residual=False),
    replace(SMALL, concat=3),
    replace(SMALL, concat=0),
    replace(SMALL, blocks=3),
    replace(SMALL, blocks=5),
    replace(SMALL, blocks=7),
]
NETWORKS = [lambda c=c: LambertianPriorNet(c) for c in VARIANTS] + [
    lambda: awake(small()),
    lambda: awake(small(memory=4, coarse=2, attention=2, expected=True)),
    lambda: awake(small(coarse=1, far=1)),
    lambda: awake(small(coarse=1, far=1, level=True, compass=True)),
    lambda: PSFCNNet(PSFCNConfig(width=4)),
    lambda: PSFCNNet(PSFCNConfig(width=4, normalised=True)),
    lambda: CNNPSNet(CNNPSConfig(side=8, grown=4, hidden=8)),
    lambda: LMPSNet(LMPSConfig(side=8, grown=4, hidden=8)),
    lambda: SPLINENet(SPLINENetConfig(side=8, width=4, blocks=1, grown=4, hidden=8)),
    lambda: GPSNet(GPSNetConfig(filters=8, order=8, width=8)),
    lambda: AttentionPSNNet(AttentionPSNConfig(width=8, shallow=1, deep=1)),
    lambda: AttentionPSNNet(AttentionPSNConfig(width=8, shallow=2, deep=3)),
    lambda: DRPSNNet(DRPSNConfig(width=4)),
]


def awake(net):
    """A correction layer that corrects, as after training."""
    for weight in (*starting_at_zero(net), net.correction.weight):
        torch.nn.init.normal_(weight, std=0.1)
    return net


def observations(b=2, n=5, h=16, w=24, seed=0):
    g = torch.Generator().manual_seed(seed)
    images = torch.rand(b, n, 3, h, w, generator=g)
    lights = torch.nn.functional.normalize(torch.randn(b, n, 3, generator=g) + torch.tensor([0, 0, 2.0]), dim=-1)
    prior = torch.nn.functional.normalize(
        torch.randn(b, 3, h, w, generator=g) + torch.tensor([0, 0, 2.0])[:, None, None]
    )
    return images, lights, prior


@pytest.mark.parametrize(
    ("config", "millions"),
    [
        (PAPER, 8.046),  # reading A with regressor R1
        (replace(PAPER, exchange=False), 7.636),  # reading B
        (replace(PAPER, prior=""), 4.309),
        (replace(PAPER, concat=3), 8.046),
        (replace(PAPER, concat=0), 8.044),
    ],
)
def test_parameters_of_the_paper_network(config, millions):
    assert round(parameters(LambertianPriorNet(config)) / 1e6, 3) == millions


def test_parameters_of_its_parts():
    net = LambertianPriorNet()
    assert round(parameters(net.image) / 1e6, 3) == 2.738
    assert round(parameters(net.prior) / 1e6, 3) == 3.145
    assert round(parameters(net.regressor) / 1e6, 3) == 2.163


def test_parameters_of_psfcn():
    assert parameters(PSFCNNet()) == 2_210_048


def test_parameters_of_cnnps():
    assert parameters(CNNPSNet()) == 2_654_051


def test_normals_of_maps_turn_with_the_lights():
    """A mean over four turns can't tell a quarter turn of the lights."""
    torch.manual_seed(0)
    net = CNNPSNet(CNNPSConfig(side=8, grown=4, hidden=8)).eval()
    net.turns = 4
    images, lights, none = observations()
    with torch.no_grad():
        N, turned = net(images, lights, none), net(images, about_view(lights, torch.pi / 2), none)
    torch.testing.assert_close(about_view(N.movedim(1, -1), torch.pi / 2), turned.movedim(1, -1), atol=1e-5, rtol=0)


def test_blocks_are_numbered_as_in_the_paper():
    sizes = [parameters(LambertianPriorNet(replace(PAPER, blocks=b))) for b in (3, 5, 6, 7)]
    assert sizes == sorted(sizes)
    with pytest.raises(InputError, match="4 blocks came but a branch has 3, 5, 6 or 7"):
        LambertianPriorConfig(blocks=4)
    with pytest.raises(InputError, match=r"width 12 came; .* width a multiple of 8"):
        LambertianPriorConfig(width=12)


@pytest.mark.parametrize("make", NETWORKS)
def test_unit_normals_in_any_order_and_portions(make):
    torch.manual_seed(0)
    net = make().eval()
    images, lights, prior = observations()
    with torch.no_grad():
        N = net(images, lights, prior)
        order = torch.tensor([3, 0, 4, 1, 2])
        shuffled = net(images[:, order], lights[:, order], prior)
        shared = net.begin(prior, lights)
        pooled = net.encode(images[:, :2], lights[:, :2], shared)
        pooled = pooled.merged(net.encode(images[:, 2:], lights[:, 2:], shared))
        streamed = net.decode(pooled, 5, shared)
    torch.testing.assert_close(N[:, :3].norm(dim=1), torch.ones(2, 16, 24))
    torch.testing.assert_close(N, shuffled, atol=1e-5, rtol=0)
    torch.testing.assert_close(N, streamed, atol=1e-5, rtol=0)


@pytest.mark.parametrize("make", NETWORKS)
def test_nothing_beyond_its_reach_changes_a_normal(make):
    torch.manual_seed(0)
    net = make().eval()
    side = 2 * net.reach + 8
    images, lights, prior = observations(b=1, n=2, h=max(4, net.stride), w=side)
    other_images, _, other_prior = observations(b=1, n=2, h=max(4, net.stride), w=side, seed=1)
    column = 4  # everything right of column + reach may change
    images2, prior2 = images.clone(), prior.clone()
    images2[..., column + net.reach :] = other_images[..., column + net.reach :]
    prior2[..., column + net.reach :] = other_prior[..., column + net.reach :]
    with torch.no_grad():
        N, N2 = net(images, lights, prior), net(images2, lights, prior2)
    torch.testing.assert_close(N[..., :column], N2[..., :column], atol=1e-6, rtol=0)
    assert (N - N2).abs().max() > 1e-4


def test_a_leaf_is_weighed_by_a_chebyshev_series_of_its_relation():
    torch.manual_seed(0)
    net = Filters(filters=3, order=6)
    x = torch.randn(2, 5, 4)
    with torch.no_grad():
        r = net.relation(x)[..., 0].numpy()
        V = net.V.weight.unflatten(1, (6, 4)).numpy()  # (filters, order, 4)
        weights = np.stack([chebval(r, V[f]) for f in range(3)], -1)  # (4, p, k, filters)
        np.testing.assert_allclose(net(x), np.einsum("cpkf,pkc->pkf", weights, x), atol=1e-4)


@pytest.mark.parametrize(
    ("make", "channels"),
    [
        (lambda: AttentionPSNNet(AttentionPSNConfig(width=8, shallow=1, deep=1)), 1),
        (lambda: DRPSNNet(DRPSNConfig(width=4, rendered=2)), 2 * 3),
    ],
)
def test_what_only_a_loss_needs_follows_the_normals_in_training_alone(make, channels):
    torch.manual_seed(0)
    net, (images, lights, prior) = make(), observations()
    with torch.no_grad():
        learning, measuring = net.train()(images, lights, prior), net.eval()(images, lights, prior)
    assert measuring.shape == (2, 3, 16, 24) and learning.shape == (2, 3 + channels, 16, 24)
    torch.testing.assert_close(learning[:, :3], measuring)


def test_attention_is_told_from_edges_alone():
    torch.manual_seed(0)
    attention = AttentionPSNNet(AttentionPSNConfig(width=8, shallow=1, deep=1)).attention
    images = torch.full((1, 3, 3, 40, 40), 0.5)
    images[:, 1, :, :, 20:] = 1  # one of three shows an edge
    with torch.no_grad():
        P = attention(images)[0, 0]
    assert P.min() == 0 and P.max() == 1
    flat, edge = P[10:30, 8:12], P[10:30, 16:24]  # out of reach of the border
    assert flat.std() < 1e-4 < 1e-2 < edge.std()


def test_images_rendered_back_change_with_their_light_alone():
    torch.manual_seed(0)
    net, (images, lights, prior) = DRPSNNet(DRPSNConfig(width=4)), observations()
    others = lights.clone()
    others[:, 1] = lights[:, 0]
    with torch.no_grad():
        N = net(images, lights, prior)[:, :3]
        common = net.encode(images, lights, None).maximum
        a, b = net.back(N, lights, common), net.back(N, others, common)
    torch.testing.assert_close(a[:, 2:], b[:, 2:])
    torch.testing.assert_close(b[:, 0], b[:, 1])
    assert (a[:, 1] - b[:, 1]).abs().max() > 1e-3


def test_the_prior_matters_only_where_it_enters():
    images, lights, prior = observations()
    torch.manual_seed(0)
    with torch.no_grad():
        without = LambertianPriorNet(replace(SMALL, prior=""))
        torch.testing.assert_close(without(images, lights, prior), without(images, lights, -prior))
        for config in (SMALL, replace(SMALL, exchange=False), replace(SMALL, concat=0), replace(SMALL, branches=1)):
            net = LambertianPriorNet(config)
            assert (net(images, lights, prior) - net(images, lights, -prior)).abs().max() > 1e-3


def test_independent_branches_equal_pooling_both():
    """In reading B the prior's features are the same for all images: pooling them changes nothing."""
    torch.manual_seed(0)
    net = LambertianPriorNet(replace(SMALL, exchange=False))
    _, lights, prior = observations()
    with torch.no_grad():
        one = net.begin(prior, lights)
        of_each = net.prior(prior.repeat_interleave(5, 0))[-1].unflatten(0, (2, 5))
        torch.testing.assert_close(one.features, of_each.amax(1), atol=1e-5, rtol=1e-5)


def test_pooling_has_the_gradient_of_maximum_and_sum():
    g = torch.Generator().manual_seed(0)
    x = torch.randn(2, 6, 5, 3, generator=g, dtype=torch.float64, requires_grad=True)
    a, b = (torch.randn(2, 5, 3, generator=g, dtype=torch.float64) for _ in range(2))
    pooled = pool(x, total=True)
    ((pooled.maximum * a).sum() + (pooled.total.double() * b).sum()).backward()
    gradient, x.grad = x.grad, None
    ((x.amax(1) * a).sum() + (x.sum(1) * b).sum()).backward()
    torch.testing.assert_close(gradient, x.grad, atol=1e-6, rtol=1e-6)
    (pool(x).maximum * a).sum().backward()
    expected = torch.autograd.grad((x.amax(1) * a).sum(), x)[0]
    torch.testing.assert_close(x.grad, expected + gradient, atol=1e-6, rtol=1e-6)


def test_a_weighted_sum_leaves_out_what_weighs_nothing():
    g = torch.Generator().manual_seed(0)
    x = torch.randn(4, 5, 6, generator=g, dtype=torch.float64, requires_grad=True)
    w = torch.rand(4, 5, 2, generator=g, dtype=torch.float64)
    w[:, 1] = 0
    total = weighted_sum(x, w.requires_grad_())
    others = [0, 2, 3, 4]
    torch.testing.assert_close(total, weighted_sum(x[:, others], w[:, others]))
    plain = (x * w.repeat_interleave(3, dim=-1)).sum(1)
    torch.testing.assert_close(total, plain.float())
    a = torch.randn(4, 6, generator=g)
    found = torch.autograd.grad((total * a).sum(), (x, w))
    expected = torch.autograd.grad((plain * a).sum(), (x, w))
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other, atol=1e-6, rtol=1e-6)


def test_merged_portions_are_the_whole():
    x = torch.randn(2, 6, 5, generator=torch.Generator().manual_seed(0))
    whole = pool(x, total=True)
    parts = pool(x[:, :4], total=True).merged(pool(x[:, 4:], total=True))
    assert isinstance(parts, Pooled)
    torch.testing.assert_close(parts.maximum, whole.maximum)
    torch.testing.assert_close(parts.total, whole.total)


@pytest.mark.parametrize("scaling", ["exposure", "channels", "grey"])
def test_exposure_and_background_do_not_enter(scaling):
    images, _, _ = observations()
    mask = torch.zeros(2, 1, 16, 24, dtype=torch.bool)
    mask[..., 3:12, 5:20] = True
    bright = torch.where(mask[:, None], 7 * images, 1e3)
    a = scaled(scaling, images, mask, moment(scaling, images, mask), 5)
    b = scaled(scaling, bright, mask, moment(scaling, bright, mask), 5)
    torch.testing.assert_close(a, b)
    assert not a[:, :, :, ~mask[0, 0]].any()
    parts = moment(scaling, images[:, :2], mask) + moment(scaling, images[:, 2:], mask)
    torch.testing.assert_close(parts, moment(scaling, images, mask))


def test_black_pixels_stay_black():
    images, _, _ = observations()
    images[..., 4, 4] = 0
    mask = torch.ones(2, 1, 16, 24, dtype=torch.bool)
    for scaling in ("exposure", "channels", "grey"):
        assert not scaled(scaling, images, mask, moment(scaling, images, mask), 5)[..., 4, 4].any()


def test_vectors_get_unit_length_and_zero_stays_zero():
    x = torch.randn(2, 3, 5, 4, generator=torch.Generator().manual_seed(0), requires_grad=True)
    y = x * (torch.arange(4) > 0)
    torch.testing.assert_close(unit(y), torch.nn.functional.normalize(y, dim=1))
    unit(y)[:, 0].sum().backward()
    assert x.grad is not None and x.grad.isfinite().all()
    torch.testing.assert_close(unit(y[0], axis=0), unit(y)[0])


def test_a_residual_branch_begins_small():
    torch.manual_seed(0)
    block = LambertianPriorNet(SMALL).image.scales[0][1]  # its shortcut changes nothing
    x = torch.randn(2, 8, 16, 16)
    beside = torch.nn.functional.leaky_relu(x, 0.1)
    assert 0 < (block(x) - beside).square().mean() < 0.1 * beside.square().mean()
