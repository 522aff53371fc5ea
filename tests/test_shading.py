"""Facts about how light arrives."""

import pytest
import torch

from photonormal.shading import cosines, fall_off, half_vectors, over_lights, towards

X = torch.tensor([[0.0, 0, 0], [3, 0, 0]])
S = torch.tensor([[0.0, 0, 4], [0, 0, 8], [3, 4, 0]])


def test_light_falls_with_the_square_of_the_distance():
    L, r = towards(X, S)
    e = fall_off(L, r)
    assert e[0, 0] / e[0, 1] == pytest.approx(4)
    assert r[1].tolist() == pytest.approx([5, 73**0.5, 4])
    assert L[1, 0].tolist() == pytest.approx([-0.6, 0, 0.8])


def test_a_lamp_shines_most_along_its_axis():
    L, r = towards(X, S[:1])
    axis = torch.tensor([[0.0, 0, -1]])
    lambertian = fall_off(L, r, axis, torch.ones(1)) * r**2
    assert lambertian[:, 0].tolist() == pytest.approx([1, 0.8])
    assert torch.equal(fall_off(L, r, axis, torch.zeros(1)), fall_off(L, r))
    assert fall_off(L, r, -axis, torch.ones(1)).max() == 0  # behind it


def test_lights_of_each_pixel_and_of_all():
    N, L = torch.randn(5, 3), torch.randn(7, 3)
    each = L.expand(5, 7, 3)
    assert torch.allclose(cosines(N, each), cosines(N, L), atol=1e-6)
    assert torch.allclose(over_lights(cosines(N, L), each), cosines(N, L) @ L, atol=1e-5)
    assert torch.allclose(cosines(N[None], each[None])[0], cosines(N, L), atol=1e-6)


def test_a_light_from_right_behind_has_nothing_halfway():
    H = half_vectors(torch.tensor([[0.0, 0, -1], [0, 0, 1], [0.8, 0, 0.6]]))
    assert H[0].tolist() == [0, 0, 0]
    assert torch.allclose(H[1:].norm(dim=-1), torch.ones(2))
