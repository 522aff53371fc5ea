"""A pixel's samples as a graph."""

import torch

from photonormal.methods.inputs.graphs import leaves


def test_a_leaf_is_a_sample_and_its_light():
    g = torch.Generator().manual_seed(0)
    I, L = torch.rand(2, 5, 3, 4, generator=g), torch.randn(2, 5, 3, generator=g)
    found = leaves(I, L)
    assert found.shape == (2 * 3 * 4, 5, 4)
    pixel = found.unflatten(0, (2, 3, 4))[1, 2, 3]
    torch.testing.assert_close(pixel, torch.cat([I[1, :, 2, 3, None], L[1]], dim=1))


def test_lights_that_all_pixels_see_alike_are_one_for_all():
    g = torch.Generator().manual_seed(0)
    I, L = torch.rand(1, 5, 3, 4, generator=g), torch.randn(1, 5, 3, generator=g)
    torch.testing.assert_close(leaves(I, L), leaves(I, L[..., None, None].expand(1, 5, 3, 3, 4)))
