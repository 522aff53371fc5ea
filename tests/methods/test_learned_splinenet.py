"""SPLINE-Net: gaps are filled where lights can be, from what is shown alone; the same samples mirrored are no error."""

import pytest
import torch

from photonormal.methods.inputs.maps import disc
from photonormal.methods.learned.network import parameters
from photonormal.methods.learned.splinenet import (
    FEWEST,
    Interpolator,
    SPLINENet,
    SPLINENetConfig,
    asymmetry,
    mean_where,
    some,
)
from photonormal.shading import normalised
from photonormal.types import InputError
from tests.methods.test_learned_network import observations

SMALL = SPLINENetConfig(side=16, width=4, blocks=1, grown=4, hidden=8)


@pytest.fixture
def net():
    torch.manual_seed(0)
    return SPLINENet(SMALL)


def seen(b=2, n=9, h=3, w=5):
    images, lights, none = observations(b=b, n=n, h=h, w=w)
    return images[:, :, :1], lights, none


def test_parameters_of_the_paper_network():
    assert parameters(Interpolator(64, 6)) == 8_398_593


def test_maps_that_cannot_be_halved_twice_are_refused():
    with pytest.raises(InputError, match=r"side 14 came .* multiple of 4"):
        SPLINENetConfig(side=14)


def test_a_map_is_read_beside_its_gaps_filled_where_lights_can_be(net):
    maps = torch.rand(3, 16, 16)
    with torch.no_grad():
        given, filled = net.eval().read(maps).unbind(1)
    torch.testing.assert_close(given, maps)
    assert filled.min() == 0 and filled.max() <= 1
    assert (filled[:, disc(16)] > 0).all() and not filled[:, ~disc(16)].any()


def test_it_is_shown_four_to_all_samples_while_it_learns():
    count = some(torch.rand(8, 40, 1, 2, 3)).sum(1).flatten()
    assert count.min() >= FEWEST and count.min() <= 6 and count.max() >= 35 and count.max() <= 40
    assert (count <= 13).float().mean() == pytest.approx(0.5, abs=0.1)  # the middle between 4 and 40, on a log scale
    assert some(torch.rand(1, 3, 1, 4, 4)).all()


def test_what_is_hidden_changes_no_normal_but_what_is_taught(net):
    images, lights, none = seen()
    hidden = some(images) == 0
    other = torch.where(hidden, 0.5 * images, images)
    with torch.no_grad():
        a, b = net.train()(images, lights, none), net(other, lights, none)
    assert a.shape == (2, 3 + 2, 3, 5) and hidden.any()
    torch.testing.assert_close(a[:, :3], b[:, :3])
    assert (a[:, 3] - b[:, 3]).abs().max() > 1e-3


def test_samples_told_exactly_are_no_error(net):
    images, lights, _ = seen(n=3)  # so few are all shown, and fill their cells alone
    images = images / images.amax(1, keepdim=True)
    maps = net.encode(images, lights, None).maximum
    digested = torch.cat([torch.zeros(2, 3, 5, 3), maps.flatten(3)], dim=-1)
    N = torch.zeros(2, 3, 3, 5)
    torch.testing.assert_close(net.teach(images, lights, digested, N)[:, 0], torch.zeros(2, 3, 5))
    digested[..., 3:] += 0.125
    torch.testing.assert_close(net.teach(images, lights, digested, N)[:, 0], torch.full((2, 3, 5), 0.25))


def test_only_lit_cells_enter_a_mean():
    x, where = torch.tensor([[[1.0, 2], [4, 8]]]), torch.tensor([[[1.0, 0], [0, 1]]])
    assert mean_where(x, where).item() == 4.5 and mean_where(x, 0 * where).item() == 0


def test_a_matt_surface_is_symmetric_about_its_own_normal_alone():
    at = torch.linspace(-1, 1, 33)
    x, y = torch.meshgrid(at, at, indexing="xy")
    L = torch.stack([x, y, (1 - x**2 - y**2).clamp(min=0).sqrt()], dim=-1)
    N = normalised(torch.tensor([[0.5, 0.2, 1.0], [-0.3, 0.6, 1.0]]))
    D = (L @ N.T).clamp(min=0).permute(2, 0, 1) * (x**2 + y**2 <= 1)
    own, other = asymmetry(D, N), asymmetry(D, N.flip(0))
    assert (own < 0.2 * other).all()
