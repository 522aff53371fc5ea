"""A stream is seeded, resumable, endless and never repeats; its windows lie on curved parts of objects."""

from dataclasses import fields
from itertools import islice

import pytest
import torch

from photonormal.synth import RenderedBatch, Stream
from photonormal.synth.stream import number_of_lights
from photonormal.types import InputError

SMALL = {"size": 48, "crop": 16, "crops": 4, "scenes": 2, "lights": (6, 6)}


@pytest.fixture(autouse=True)
def no_measured_materials(monkeypatch):
    monkeypatch.delenv("PHOTONORMAL_DATA", raising=False)


def batches(n: int, **changes) -> list[RenderedBatch]:
    return list(islice(Stream("train", 4, **{**SMALL, **changes}), n))


def same(a: RenderedBatch, b: RenderedBatch) -> bool:
    return all(torch.equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(RenderedBatch))


def test_what_a_batch_holds():
    batch = batches(1)[0]
    assert batch.images.shape == (4, 6, 3, 16, 16) and batch.images.dtype == torch.float32
    assert batch.lights.shape == (4, 6, 3) and batch.normals.shape == (4, 3, 16, 16)
    assert batch.mask.shape == (4, 1, 16, 16) and batch.mask.dtype == torch.bool
    assert batch.images.isfinite().all() and (batch.images >= 0).all() and (batch.images <= 1).all()
    assert torch.allclose(batch.lights.norm(dim=-1), torch.ones(4, 6), atol=1e-5)
    length = batch.normals.norm(dim=1, keepdim=True)
    assert torch.allclose(length[batch.mask], torch.ones(int(batch.mask.sum())), atol=1e-4)
    assert not length[~batch.mask].any()
    assert not (batch.images * ~batch.mask[:, None]).any()
    assert (batch.mask.float().mean((1, 2, 3)) >= 0.5).all()
    flatness = 1 - (batch.normals.sum((2, 3)) / batch.mask.sum((2, 3))).square().sum(1)
    assert (flatness > 0.009).all()


def test_a_stream_goes_on_where_another_stopped_and_never_repeats():
    whole = batches(5)  # blocks of two batches
    for step in (1, 2, 3):
        assert same(batches(1, start_step=step)[0], whole[step])
    samples = torch.cat([batch.images.flatten(1) for batch in whole])
    assert len(torch.unique(samples, dim=0)) == 20


def test_the_lights_of_a_rig_are_believed_where_they_were_measured():
    """And each scene is lit from a little elsewhere."""
    rig = ((0.6, 0.0, 0.8), (0.0, 0.6, 0.8), (0.0, 0.0, 1.0), (-0.6, 0.0, 0.8))
    exact, off = (batches(1, directions=rig, light_error_deg=e)[0] for e in (0.0, 3.0))
    for batch in (exact, off):
        assert batch.images.shape == (4, 4, 3, 16, 16)
        torch.testing.assert_close(batch.lights, torch.tensor(rig).expand(4, 4, 3))
    assert not torch.equal(exact.images, off.images)


def test_seeds_decide():
    assert same(batches(1, seed=3)[0], batches(1, seed=3)[0])
    assert not same(batches(1, seed=3)[0], batches(1, seed=4)[0])


def test_threads_change_nothing():
    torch.set_num_threads(2)
    two = batches(2, scenes=10)
    torch.set_num_threads(1)
    one = batches(2, scenes=10)
    assert all(torch.allclose(a.images, b.images, atol=1e-6) for a, b in zip(one, two, strict=True))


def test_light_counts_spread_over_the_range_and_stay_in_it():
    recipe = Stream("train", lights=(8, 64)).recipe_of(0)
    counts = [number_of_lights(recipe, 0, k) for k in range(400)]
    assert min(counts) == 8 and max(counts) > 56 and max(counts) <= 64
    assert 18 < sorted(counts)[200] < 28  # log-uniform: the median is sqrt(8 * 64)


def test_windows_that_nothing_can_fill_are_an_error():
    with pytest.raises(InputError, match="lower coverage or crop"):
        batches(1, shapes=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), coverage=1.0, crop=47, crops=1, zoom=0.0)


def test_a_mixture_draws_its_blocks_in_proportion():
    stream = Stream("blobs-and-sculptures", 4, **SMALL)
    smooth = [stream.recipe_of(k).detail < 1 for k in range(4000)]
    assert abs(sum(smooth) / 4000 - 25_660 / (25_660 + 58_700)) < 0.03
    first = next(k for k in range(20) if smooth[k] != smooth[0])  # blocks of two batches: some of both kinds
    whole = list(islice(Stream("blobs-and-sculptures", 4, **SMALL), 2 * first + 2))
    late = list(islice(Stream("blobs-and-sculptures", 4, start_step=2 * first + 1, **SMALL), 1))
    assert same(whole[-1], late[0])


def test_meshes_are_seen_where_there_are_some(tmp_path, monkeypatch):
    from photonormal.synth.meshes import MeshViews
    from photonormal.synth.params import rng
    from photonormal.synth.recipes import recipe
    from photonormal.synth.scene import draw_scenes

    def share() -> float:
        made = [draw_scenes(recipe("sculptures"), rng(k), 1, 4, None).solids for k in range(100)]
        return sum(isinstance(s, MeshViews) for s in made) / 100

    assert share() == 0
    (tmp_path / "meshes").mkdir()
    corners, faces = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"], ["1 3 2", "1 2 4", "1 4 3", "2 3 4"]
    text = [*(f"v {c}" for c in corners), *(f"f {f}" for f in faces)]
    (tmp_path / "meshes" / "four.obj").write_text("\n".join(text))
    monkeypatch.setenv("PHOTONORMAL_DATA", str(tmp_path))
    assert 0.25 < share() < 0.55
