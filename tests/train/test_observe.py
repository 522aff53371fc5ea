"""What a network is shown: drawn by seed and step alone, turned consistently, with a prior of the same images."""

import itertools
from dataclasses import replace

import pytest
import torch

from photonormal.methods.learned.lightsnet import SIDE, LightsConfig, LightsNet
from photonormal.methods.learned.network import PixelNetwork
from photonormal.methods.uncalibrated.guess import looked
from photonormal.synth.recipes import parts
from photonormal.train.observe import observe, tilted, turn
from photonormal.train.recipes import ONE_RIG, RECIPES, Recipe, for_rig, recipe
from photonormal.train.replay import replayed
from photonormal.types import InputError
from tests.scenes import ring
from tests.train.toy import Batch, Toy, scenes

PLAIN = Recipe(images=(4, 8))


def batch(seed=0):
    return Batch(*scenes(3, 8, 16, torch.Generator().manual_seed(seed)))


def test_the_same_step_shows_the_same():
    loud = replace(PLAIN, priors=(("woodham", 0.5), ("truth", 0.5)), turns=True)
    for step in range(4):
        a, b = (observe(batch(), loud, "exposure", step) for _ in range(2))
        for x, y in zip(a, b, strict=True):
            torch.testing.assert_close(x, y, atol=0, rtol=0)
    assert len({observe(batch(), loud, "exposure", step).images.sum().item() for step in range(6)}) == 6
    assert (
        observe(batch(), loud, "exposure", 0, rank=1).images.sum() != observe(batch(), loud, "exposure", 0).images.sum()
    )


def test_all_processes_look_at_as_many_images_and_at_the_same_prior():
    """The one with more to do would keep the others waiting."""
    recipe = replace(PLAIN, priors=(("woodham", 0.5), ("l1", 0.5)))
    for step in range(8):
        one, other = (observe(batch(), recipe, "exposure", step, rank) for rank in (0, 1))
        assert one.images.shape == other.images.shape
    whole = replace(recipe, images=(8, 8))
    for step in range(8):
        one, other = (observe(batch(), whole, "exposure", step, rank) for rank in (0, 1))
        apart = (one.prior * other.prior).sum(1)[one.mask[:, 0]]  # cosines; the images come in another order
        assert apart.min() > 0.999


def test_the_number_of_images_spans_its_range():
    seen = {observe(batch(), PLAIN, "exposure", step).images.shape[1] for step in range(60)}
    assert seen == {4, 5, 6, 7, 8}


def test_intensities_are_in_the_images_and_within_their_range():
    plain, drawn = (
        observe(batch(), r, "exposure", 3, vary=False) for r in (PLAIN, replace(PLAIN, intensities=(0.5, 2)))
    )
    assert (plain.intensities == 1).all() and len(drawn.intensities.unique()) > 8
    assert drawn.intensities.min() >= 0.5 and drawn.intensities.max() <= 2
    ratio = drawn.images / plain.images.clamp(min=1e-6) / drawn.intensities[..., None, None, None]
    sure = (plain.images > 0.01) & (plain.images < 0.5) & (drawn.images < 1.9)
    for one, told in zip(ratio, sure, strict=True):  # up to each sample's exposure
        assert one[told].std() < 1e-3 * one[told].mean()


@pytest.mark.parametrize("case", range(8))
def test_a_turned_matt_scene_is_still_one(case):
    """I = n.l holds for turned images, lights and normals: they turn together."""
    _, lights, normals, mask = batch()
    shading = torch.einsum("bnc,bchw->bnhw", lights, normals).clamp(min=0)[:, :, None]
    images, l, n, m = turn(shading, lights, normals, mask, case)
    torch.testing.assert_close(torch.einsum("bnc,bchw->bnhw", l, n).clamp(min=0)[:, :, None], images)
    assert (m.sum(), case % 2) == (mask.sum(), case % 2)
    torch.testing.assert_close(n.norm(dim=1), m[:, 0].float())


def shading_of(lights, normals):
    """n.l, of lights that all pixels share or their own."""
    each = lights if lights.ndim == 5 else lights[..., None, None].expand(*lights.shape, *normals.shape[2:])
    return torch.einsum("bnchw,bchw->bnhw", each, normals).clamp(min=0)[:, :, None]


def test_pixels_by_themselves_are_turned_each_by_its_own_angle():
    _, lights, normals, mask = batch()
    images = shading_of(lights, normals).expand(-1, -1, 3, -1, -1) * mask[:, None]
    recipe = replace(PLAIN, pixels=20, priors=(), turns=True)
    seen = observe(Batch(images, lights, normals, mask), recipe, "exposure", 0)
    n = seen.images.shape[1]
    assert seen.images.shape == (3, n, 3, 1, 20) and seen.lights.shape == (3, n, 3, 1, 20) and seen.mask.all()
    torch.testing.assert_close(seen.normals.norm(dim=1), torch.ones(3, 1, 20))
    ratio = seen.images[:, :, :1] / shading_of(seen.lights, seen.normals)  # an exposure for each sample
    for one in ratio:
        assert one[one.isfinite()].std() < 1e-3
    apart = (seen.lights[..., 0, :1] - seen.lights[..., 0, 1:]).abs().amax((1, 2))
    assert apart.median() > 0.1 and apart.min() > 0
    still = observe(Batch(images, lights, normals, mask), replace(recipe, turns=False), "exposure", 0)
    assert still.lights.shape == (3, n, 3)
    whole = observe(Batch(images, lights, normals, mask), recipe, "exposure", 0, vary=False)
    assert whole.images.shape == (3, 8, 3, 16, 16)  # an exam shows all


def test_a_share_of_the_samples_is_made_black():
    bright = batch()._replace(images=torch.ones(3, 8, 3, 16, 16))
    for some, share in ((replace(PLAIN, dark=0.25, images=(8, 8)), 0.25), (PLAIN, 0.0)):
        seen = observe(bright, some, "channels", 0)
        black = (seen.images == 0)[seen.mask[:, None].expand_as(seen.images)].float().mean()
        assert abs(black - share) < 0.02
    assert (observe(bright, replace(PLAIN, dark=0.25), "channels", 0, vary=False).images > 0).any(1)[:, :, 2:].all()


def test_a_rig_is_for_networks_that_learn_for_one():
    r = for_rig(recipe("dpsn"), 3 * ring(6))
    assert r.images == (7, 7) and r.rendered["lights"] == (7, 7)
    torch.testing.assert_close(torch.tensor(r.rig), torch.from_numpy(ring(6)).float())
    assert r.rendered["directions"] == r.rig == r.built["lights"] and "directions" not in recipe("cnn-ps").rendered
    with pytest.raises(InputError, match="dpsn learns for one rig; name its lights with --lights"):
        for_rig(recipe("dpsn"), None)
    with pytest.raises(InputError, match="--lights came but psfcn learns for any lights; leave it out"):
        for_rig(recipe("psfcn"), ring(6))


def test_least_squares_prior_of_a_matt_scene_is_the_truth():
    _, lights, normals, mask = batch()
    images = (torch.einsum("bnc,bchw->bnhw", lights, normals) + 1)[:, :, None] * mask[:, None]
    lifted = torch.einsum("bnc,bchw->bnhw", lights, normals)[:, :, None] * mask[:, None]  # no shadow: linear
    seen = observe(Batch(lifted, lights, normals, mask), Recipe(images=(8, 8)), "grey", 0, vary=False)
    torch.testing.assert_close(seen.prior, normals, atol=1e-4, rtol=0)
    assert not torch.allclose(observe(Batch(images, lights, normals, mask), PLAIN, "grey", 0).prior, normals, atol=1e-2)


def test_every_named_prior_is_made():
    for name in ("woodham", "trimmed", "l1", "truth"):
        seen = observe(batch(), replace(PLAIN, priors=((name, 1.0),)), "exposure", 0)
        length = seen.prior.norm(dim=1)
        torch.testing.assert_close(length, seen.mask[:, 0].float(), atol=1e-4, rtol=0)
    assert not observe(batch(), replace(PLAIN, priors=()), "exposure", 0).prior.any()


def test_the_tilted_truth_is_near_the_truth():
    _, _, normals, mask = batch()
    N = tilted(normals, torch.Generator().manual_seed(0))
    cos = (N * normals).sum(1)[mask[:, 0]]
    assert 0.85 < cos.min() and cos.max() < 1 and cos.mean() < 0.999


def test_the_toy_resumes():
    third = [next(iter(Toy("", 2, "cpu", 1, start_step=2)))]
    stream = iter(Toy("", 2, "cpu", 1))
    torch.testing.assert_close([next(stream) for _ in range(3)][2].images, third[0].images)


@pytest.mark.parametrize("name", RECIPES)
def test_every_recipe_builds_its_network_and_has_a_falling_rate(name):
    from photonormal.methods.learned.weights import build

    r = recipe(name)
    r = for_rig(r, ring(5) if r.network in ONE_RIG else None)
    net = build(r.network, r.built)
    assert parts(r.stream, **r.rendered)
    assert not r.pixels or isinstance(net, PixelNetwork)
    shares = [r.share(r.warmup + i, i / 100) for i in range(101)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] == 1 and shares[-1] <= 0.04
    assert bool(r.priors) == bool(net.config.prior)


def test_unknown_recipes_are_named():
    with pytest.raises(InputError, match="no recipe 'papper'; perhaps paper is meant; choose from paper"):
        recipe("papper")
    with pytest.raises(InputError, match="no schedule 'linear'"):
        Recipe(schedule="linear")


def test_a_ring_of_batches_resumes():
    """Every batch comes when it is new; what comes between is one of the last; a late start yields the same."""
    recipe = Recipe(reuse=3, ring=4)

    def source(start_step):
        return itertools.count(start_step)

    whole = list(itertools.islice(replayed(source, 0, recipe), 60))
    assert whole[::3] == list(range(20))
    assert all(step // 3 - 4 < k <= step // 3 for step, k in enumerate(whole))
    assert len(set(whole[1::3])) > 5
    for start in (1, 5, 30, 44):
        assert list(itertools.islice(replayed(source, start, recipe), 60 - start)) == whole[start:]
    assert list(itertools.islice(replayed(source, 7, Recipe()), 5)) == [7, 8, 9, 10, 11]


def test_lights_that_a_network_tells_replace_the_true_ones(monkeypatch):
    """Directions are what it tells, and images are free of the intensities that it tells."""
    torch.manual_seed(0)
    net = LightsNet(LightsConfig(width=8)).eval()
    monkeypatch.setattr("photonormal.train.observe.teller_of_lights", lambda name, device: net)
    whole = Batch(*scenes(2, 8, SIDE, torch.Generator().manual_seed(0)))
    lit = replace(PLAIN, intensities=(0.5, 2.0))
    true, seen = (observe(whole, replace(lit, lights=name), "exposure", 3, vary=False) for name in ("", "sdps-lights"))
    told = looked(net, whole.images * true.intensities[..., None, None, None], whole.mask)
    torch.testing.assert_close(seen.lights, told.directions)
    ratio = true.images / seen.images.clamp(min=1e-9) / told.log_intensities.exp()[..., None, None, None]
    sure = (true.images > 0.01) & (true.images < 1.9) & (seen.images < 1.9)
    for one, there in zip(ratio, sure, strict=True):  # up to each sample's exposure
        assert one[there].std() < 1e-3 * one[there].mean()
