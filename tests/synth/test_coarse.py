"""Few grey levels, JPEG's blocks, tone curves that are off, clipped highlights."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from photonormal.shading import LUMA
from photonormal.synth import Stream
from photonormal.synth.coarse import CURVE, TABLE, Coarsening, dct_matrix, jpeg, stored
from photonormal.synth.recipes import recipe
from photonormal.synth.sensor import expose, photograph

G = torch.Generator().manual_seed(0)
TRAIN = recipe("train", dark=1.0, jpeg=1.0, gamma=1.0, clipped=1.0)


def smooth(c: int = 2, n: int = 3, size: int = 32) -> torch.Tensor:
    x = torch.linspace(0, 1, size)
    ramp = 0.2 + 0.3 * x[:, None] + 0.4 * x.square()
    return ramp.expand(c, n, 3, size, size).clone()


def luma(I: torch.Tensor) -> torch.Tensor:
    return torch.einsum("cnkhw,k->cnhw", 255 * I ** (1 / CURVE), I.new_tensor(LUMA))


def test_a_dark_scene_has_no_more_levels_than_drawn():
    I = torch.rand(2, 5, 3, 32, 32, generator=G)
    out = photograph(I, torch.zeros(2), torch.tensor([20.0, 65535.0]), G)
    assert len(out[0].unique()) == 21 and len(out[1].unique()) > 5000


@pytest.mark.parametrize(("black", "bias"), [(-0.5, -0.5), (0.0, 0.0), (0.5, 0.5)])
def test_what_is_added_before_rounding_is_a_bias_of_as_many_steps(black, bias):
    I = 0.05 + 0.9 * torch.rand(1, 20, 3, 64, 64, generator=G)
    out = photograph(I, torch.zeros(1), torch.tensor([40.0]), G, torch.tensor([black]))
    assert 40 * float((out - I).mean()) == pytest.approx(bias, abs=0.01)


def test_a_good_cameras_pictures_stay_as_they_are():
    I = smooth()
    assert stored(I, Coarsening.none(2, 3), np.random.default_rng(0)) is I


def test_each_fault_is_within_its_range():
    drawn = Coarsening.drawn(TRAIN, np.random.default_rng(0), 4000, 6)
    assert (drawn.levels.min(), drawn.levels.max()) == (20, 255)
    assert np.median(drawn.levels) == pytest.approx((20 * 255) ** 0.5, rel=0.05)  # as many octaves above as below
    assert abs(drawn.black).max() == 0.5 and (drawn.black == -0.5).mean() == pytest.approx(0.5, abs=0.03)
    assert np.array_equal(drawn.gain.max(1), np.ones(4000)) and drawn.gain.min() >= 1 / 3
    assert (drawn.quality.min(), drawn.quality.max()) == (60, 95)
    assert 0.9 <= drawn.gamma.min() < 0.905 and 1.095 < drawn.gamma.max() <= 1.1


def test_faults_come_in_their_shares_each_by_itself():
    drawn = Coarsening.drawn(
        replace(TRAIN, dark=0.25, jpeg=0.1, gamma=0.0, clipped=0.5), np.random.default_rng(0), 8000, 2
    )
    dark, jpegs, clipped = drawn.levels > 0, drawn.quality > 0, drawn.clipped > 0
    assert [dark.mean(), jpegs.mean(), clipped.mean()] == pytest.approx([0.25, 0.1, 0.5], abs=0.02)
    assert (dark & clipped).mean() == pytest.approx(0.125, abs=0.02)
    assert (drawn.gamma == 1).all() and (drawn.gain[~dark] == 1).all()


def test_a_recipe_without_faults_draws_nothing():
    """So that scenes of the other recipes stay what they were."""
    g = np.random.default_rng(0)
    assert (Coarsening.drawn(recipe("train"), g, 3, 4).gain == 1).all()
    assert g.random() == np.random.default_rng(0).random()


def test_a_clipped_scene_exceeds_the_range_by_its_share():
    coarse = Coarsening.drawn(TRAIN, np.random.default_rng(1), 3, 4)
    out, _ = expose(torch.rand(3, 8, 3, 32, 32, generator=G), 1, torch.from_numpy(coarse.clipped))
    assert (out[:, :, 1] >= 1).float().mean((1, 2, 3)).numpy() == pytest.approx(coarse.clipped, abs=0.005)


def test_the_cosine_transform_keeps_lengths():
    D = dct_matrix()
    assert torch.allclose(D @ D.T, torch.eye(8), atol=1e-6)


def test_jpeg_keeps_multiples_of_its_steps():
    """Coefficients of every block, and the picture within what rounding to 8 bits and to the steps can do."""
    I, D = smooth(), dct_matrix()
    out = jpeg(I, torch.full((2,), 50.0))
    blocks = luma(out).unflatten(-1, (-1, 8)).unflatten(-3, (-1, 8)).transpose(-3, -2)
    counted = D @ blocks @ D.T / torch.tensor(TABLE, dtype=torch.float32)
    assert (counted - counted.round()).abs().mean() < 0.05  # 8 bits of the picture blur them
    assert (luma(out) - luma(I)).abs().mean() < 4


def test_better_jpeg_is_nearer_and_its_blocks_begin_where_they_are_told():
    I = torch.rand(2, 3, 3, 32, 32, generator=G) ** 2
    far, near = ((luma(jpeg(I, torch.full((2,), q))) - luma(I)).square().mean() for q in (60.0, 95.0))
    assert near < 0.1 * far
    flat = torch.full((1, 1, 3, 32, 32), 0.3)
    flat[..., :12] = 0.1  # a step on the border of blocks that begin at column 4: no ringing
    e = [(luma(jpeg(flat, torch.tensor([60.0]), (x, 0))) - luma(flat)).abs().max() for x in (4, 0)]
    assert e[0] < 3 < e[1]


def test_a_tone_curve_that_is_off_is_a_power():
    I = smooth()
    coarse = replace(Coarsening.none(2, 3), gamma=np.array([1.0, 1.1]))
    out = stored(I, coarse, np.random.default_rng(0))
    assert torch.equal(out[0], I[0])
    assert torch.allclose(out[1], I[1] ** 1.1)


def test_windows_of_a_scene_share_its_camera():
    drawn = Coarsening.drawn(TRAIN, np.random.default_rng(0), 2, 3).windows(4)
    assert len(drawn.levels) == 8 and drawn.gain.shape == (8, 3)
    assert len(set(drawn.levels[:4])) == 1 and drawn.levels[0] != drawn.levels[4]


def test_dark_scenes_of_a_stream_have_few_levels():
    """Each image's samples are whole numbers of one step, under lights of its own intensity."""
    batch = next(iter(Stream("validation", 4, scenes=4, crops=1, size=64, lights=(4, 4), dark=1.0, bounce=0.0)))
    for picture in batch.images.flatten(0, 1):
        assert len(picture.unique()) <= 256
