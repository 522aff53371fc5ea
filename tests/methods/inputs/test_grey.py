"""Grey levels and what they are told by."""

import numpy as np
import pytest
import torch

from photonormal import Capture
from photonormal.geometry import fibonacci_hemisphere
from photonormal.methods.engine.samples import grey_levels
from photonormal.methods.inputs import grey
from photonormal.methods.inputs.blocks import some_pixels
from photonormal.methods.inputs.grey import Levels, level, lit, metallic, telling

LIGHTS = fibonacci_hemisphere(24)[:8]


def capture(values: np.ndarray) -> Capture:
    """Samples (p, 8) as eight pictures one pixel high."""
    return Capture(values.T[:, None, :, None].astype(np.float32), np.ones((1, len(values)), bool), LIGHTS)


def cut(values: np.ndarray) -> torch.Tensor:
    I = grey_levels(capture(values))
    return Levels.of(I).cut_(I)


def test_grey_is_the_luma_of_linear_colours():
    images = np.zeros((8, 1, 3, 3), np.float32)
    images[:, 0, 0, 0] = images[:, 0, 1, 1] = images[:, 0, 2, 2] = 1
    levels = grey_levels(Capture(images, np.ones((1, 3), bool), LIGHTS))
    assert levels[:, 0].tolist() == pytest.approx([0.298936, 0.587043, 0.114021])


def test_samples_that_are_no_number_or_negative_count_as_dark_infinite_ones_as_bright():
    values = np.full((4, 8), 0.5)
    values[0, 0], values[1, 1], values[2, 2], values[3, 3] = np.nan, np.inf, -np.inf, -0.1
    I = grey_levels(capture(values))
    assert Levels.of(I).cut_(I).diagonal().tolist() == [0, 0.5, 0, 0]


def test_highlights_are_clipped_at_one_but_bright_captures_are_not_flattened():
    values = np.random.default_rng(0).uniform(0.1, 0.5, (200, 8))
    values[0, 0] = 3
    assert cut(values)[0, 0] == 1
    assert grey_levels(capture(values))[0, 0] == 3
    brighter = cut(20 * values)
    assert (brighter / 20 - torch.from_numpy(values).float()).abs()[1:].quantile(0.98) < 1e-6


def test_dim_samples_of_metal_are_lit_and_those_of_matt_objects_are_not():
    random = np.random.default_rng(0)
    dim = np.full((10, 8), 0.004)
    matt = torch.from_numpy(np.concatenate([dim, random.uniform(0.1, 0.4, (990, 8))]))
    metal = torch.from_numpy(np.concatenate([dim, random.uniform(0.002, 0.02, (950, 8)), np.full((40, 8), 0.9)]))
    assert not lit(matt)[:10].any()
    assert lit(metal)[:10].all()


def test_metal_is_told_from_matt_objects_with_and_without_highlights():
    L = torch.from_numpy(fibonacci_hemisphere(200))
    N = torch.from_numpy(fibonacci_hemisphere(500))[:400]
    H = torch.nn.functional.normalize(L + torch.tensor([0, 0, 1.0]), dim=1)
    cos = (N @ L.T).clamp(min=0)
    highlights = cos * (N @ H.T).clamp(min=0) ** 100
    narrow = L[:, 2] > 0.7
    for lights in (narrow, narrow | True):
        I = cos[:, lights], (0.3 * cos + highlights)[:, lights], highlights[:, lights]
        assert [metallic(i, lit(i), L[lights]) for i in I] == [False, False, True]


def test_each_capture_of_a_batch_has_its_own_threshold():
    I = torch.rand(2, 50, 8) * torch.tensor([1.0, 0.01])[:, None, None]
    assert torch.equal(lit(I), torch.stack([lit(i) for i in I]))
    assert level(I, 0.5).shape == (2, 1, 1)


def test_the_order_of_images_changes_no_level_of_a_large_capture(monkeypatch):
    monkeypatch.setattr(grey, "READ", 100)
    I = torch.rand(500, 8) * torch.arange(8)
    assert level(I, 0.9) == level(I.flip(-1), 0.9)


def test_few_rows_of_a_large_capture_tell_its_levels(monkeypatch):
    monkeypatch.setattr(grey, "READ", 4000)
    monkeypatch.setattr(grey, "AMONG", 20_000)
    y, x = np.mgrid[-1:1:200j, -1:1:100j]
    mask = x**2 + y**2 < 0.9
    I = torch.from_numpy(np.maximum(x + 0.5 * y, 0)[..., None] * np.linspace(0.5, 1, 8)).float()
    some = telling(mask, 8)
    assert not (some & ~mask).any() and 4000 <= 8 * some.sum() < 8000
    assert 30 < some.any(1).sum() < 45 and telling(mask, 1).any(1).sum() > 180
    for quantile in (0.75, 0.99):
        assert level(I[some], quantile).item() == pytest.approx(I[mask].quantile(quantile).item(), rel=0.02)


def test_some_pixels_are_the_same_each_time():
    assert torch.equal(some_pixels(1000, 10), some_pixels(1000, 10))
    assert some_pixels(5, 10).tolist() == [0, 1, 2, 3, 4]
