"""What a training that begins with other weights starts from."""

import pytest
import torch

from photonormal.methods.learned.weights import build
from photonormal.train.begin import begin
from photonormal.types import InputError


@pytest.mark.parametrize(
    ("network", "config"),
    [
        ("lambertian-prior", {}),
        ("lambertian-prior", {"exchange": False, "concat": 3}),
        ("lambertian-prior", {"branches": 1, "residual": False}),
        ("lambertian-prior", {"prior": ""}),
        ("psfcn", {"normalised": True}),
    ],
)
def test_twice_the_width_begins_as_the_same_function(network, config):
    torch.manual_seed(0)
    narrow, wide = (build(network, config | {"width": w}) for w in (8, 16))
    begin(wide, narrow)
    images, lights = torch.rand(1, 2, 3, 16, 16), torch.nn.functional.normalize(torch.randn(1, 2, 3), dim=2)
    prior = torch.nn.functional.normalize(torch.randn(1, 3, 16, 16), dim=1)
    with torch.no_grad():
        torch.testing.assert_close(wide(images, lights, prior, 1), narrow(images, lights, prior, 1), atol=1e-5, rtol=0)
    fresh = [p for p in wide.parameters() if p.ndim > 1]
    assert all((p != 0).float().mean() > 0.2 for p in fresh)  # the new channels are not dead


def test_another_network_is_refused():
    with pytest.raises(InputError, match="have blocks=3, width=8 but the recipe has blocks=6, width=16"):
        begin(build("lambertian-prior", {"width": 16}), build("lambertian-prior", {"blocks": 3, "width": 8}))


def test_a_network_that_would_begin_as_another_function_is_refused():
    """normalnet turns frames, levels features and concatenates what does not double."""
    small = {"hidden": 16, "features": 16}
    with pytest.raises(InputError, match="have width=8 but the recipe has width=16"):
        begin(build("normalnet", small | {"width": 16}), build("normalnet", small | {"width": 8}))
