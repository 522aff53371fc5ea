"""Exposure, noise, quantisation and damage."""

import numpy as np
import pytest
import torch

from photonormal.synth.sensor import blur, corrupt, expose, misaligned, photograph, soften

G = torch.Generator().manual_seed(0)


def pictures(c: int = 4, n: int = 6) -> torch.Tensor:
    return torch.rand(c, n, 3, 16, 16, generator=G)


def test_exposure_saturates_the_share_that_was_asked_for():
    I = 37.0 * pictures(8)
    out, bright = expose(I, 4, torch.tensor([0.0, 0.1]))
    assert torch.allclose(bright, torch.tensor([0.9, 1.0]), atol=0.02)
    assert out[:4, :, 1].max() == pytest.approx(1, abs=0.01)
    assert (out[4:, :, 1] > 1).float().mean() == pytest.approx(0.1, abs=0.01)


def test_exposure_undoes_a_gain():
    I = pictures()
    assert torch.allclose(expose(I, 2, torch.zeros(2))[0], expose(5 * I, 2, torch.zeros(2))[0], atol=1e-6)


@pytest.mark.parametrize(("bits", "levels"), [(8, 256), (4, 16)])
def test_samples_take_no_other_values_than_the_sensors_levels(bits, levels):
    out = photograph(pictures(), torch.zeros(4), torch.full((4,), 2.0**bits - 1), G)
    steps = out * (levels - 1)
    assert torch.allclose(steps, steps.round(), atol=1e-3)
    assert out.min() >= 0 and out.max() <= 1


def test_noise_has_its_deviation_at_full_scale_and_a_third_in_the_dark():
    I = torch.tensor([0.9, 0.3]).view(2, 1, 1, 1, 1).expand(2, 20, 3, 32, 32)
    out = photograph(I, torch.full((2,), 0.02), torch.zeros(2), G)
    for value, noisy in zip((0.9, 0.3), out, strict=True):
        assert noisy.std().item() == pytest.approx(0.02 * (0.1 + 0.9 * value) ** 0.5, rel=0.05)


def test_without_errors_nothing_changes_but_clipping():
    I = 1.5 * pictures()
    assert torch.equal(photograph(I, torch.zeros(4), torch.zeros(4), G), I.clamp(0, 1))
    assert torch.equal(corrupt(I, np.zeros(4), np.random.default_rng(0)), I)
    assert torch.equal(blur(I, torch.zeros(4)), I)


def test_about_the_share_of_images_is_corrupted():
    I = pictures(20, 50)
    out = corrupt(I, np.full(20, 0.2), np.random.default_rng(0))
    changed = (out != I).flatten(2).any(-1).float().mean()
    assert changed == pytest.approx(0.2, abs=0.04)


def test_blur_keeps_the_light_and_a_constant():
    I = pictures()
    I[0] = 0.25
    out = blur(I, torch.tensor([0.2, 0.2, 0.0, 0.1]))
    assert torch.allclose(out[0], I[0], atol=1e-6)
    assert torch.equal(out[2], I[2])
    assert out[1].std() < I[1].std()
    assert torch.allclose(out.mean((3, 4)), I.mean((3, 4)), atol=0.02)


def test_only_pixels_on_occluding_edges_are_softened():
    height = torch.zeros(1, 16, 16)
    height[:, :, 8:] = 30
    I = torch.zeros(1, 5, 3, 16, 16)
    I[..., 8:] = 1
    out = soften(I, height, torch.ones(1, 16, 16, dtype=torch.bool), G)
    assert torch.equal(out[..., :7], I[..., :7]) and torch.equal(out[..., 9:], I[..., 9:])
    assert ((out[..., 7] >= 0) & (out[..., 7] <= 0.5)).all() and out[..., 7].mean() > 0.1
    assert ((out[..., 8] >= 0.5) & (out[..., 8] <= 1)).all() and out[..., 8].mean() < 0.9
    slope = 3.0 * torch.arange(16).expand(1, 16, 16)
    assert torch.equal(soften(I, slope, torch.ones(1, 16, 16, dtype=torch.bool), G)[..., 1:-1], I[..., 1:-1])


def test_measured_directions_are_off_by_the_error():
    g = np.random.default_rng(0)
    L = np.zeros((2, 4000, 3))
    L[..., 2], L[..., 0] = 0.8, 0.6
    off = np.degrees(np.arccos((misaligned(L, g, np.array([0.0, 1.5])) * L).sum(-1).clip(-1, 1)))
    assert off[0].max() < 1e-3
    assert off[1].mean() == pytest.approx(1.5 * np.sqrt(np.pi / 2), rel=0.05)  # Rayleigh
