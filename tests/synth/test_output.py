"""Sets on disk: what is written is read back, whole or not at all."""

import json

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

import photonormal as pn
from photonormal.capture.blobby import listed_samples
from photonormal.disk import at_once
from photonormal.synth import recipe, render
from photonormal.synth.layout import BlobbyWriter, RenderedObject, write_diligent
from photonormal.synth.shards import read_sample, shard_sizes
from photonormal.synth.stream import Stream
from photonormal.types import InputError

TINY = recipe("lambert", size=48, crop=48, scenes=2, lights=(5, 5))


@pytest.fixture(scope="module")
def sample():
    batch = next(iter(Stream(TINY, 1)))
    images = batch.images[0].permute(0, 2, 3, 1).numpy()
    normals = batch.normals[0].permute(1, 2, 0).numpy()
    return RenderedObject(images, batch.lights[0].numpy().astype(np.float64), normals, batch.mask[0, 0].numpy())


def test_diligent_layout_is_read_back(tmp_path, sample):
    images, lights, normals, mask = sample
    intensities = np.random.default_rng(0).uniform(0.5, 1, (5, 3))
    with at_once(tmp_path / "made") as batch:
        write_diligent(batch, sample, intensities)
    capture = pn.load(tmp_path / "made")
    assert np.array_equal(capture.mask, mask)
    assert np.allclose(capture.lights, lights, atol=1e-6)
    assert np.allclose(capture.truth.map, normals, atol=1e-5)
    for j in range(5):
        assert np.abs(capture.images[j] - images[j])[mask].max() < 2 / 65535 / 0.5


def test_blobby_layout_is_read_back(tmp_path, sample):
    images, lights, normals, mask = sample
    with at_once(tmp_path / "set") as batch:
        writer = BlobbyWriter(batch)
        for k in range(3):
            writer.write(f"blob{k}", "alum-bronze", sample)
    listed = listed_samples(tmp_path / "set")
    assert len(listed) == 3
    capture = pn.load(listed[1])
    assert np.array_equal(capture.mask, mask)
    assert np.allclose(capture.lights, lights, atol=1e-5)
    assert pn.score(capture.truth, pn.Normals(normals, mask)).mean_deg < 0.5  # 8 bits
    assert np.abs(capture.images[2] - images[2])[mask].max() <= 0.51 / 255


@pytest.mark.parametrize("layout", ["diligent", "blobby", "shards"])
def test_render_writes_as_many_samples_as_asked_for(tmp_path, layout):
    told = []
    out = render(TINY, 3, tmp_path / "out", preview=True, progress=lambda *a: told.append(a), layout=layout)
    assert told[-1] == (3, 3)
    assert (out / "contact-sheet.png").stat().st_size > 1000
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    if layout == "shards":
        assert json.loads((out / "recipe.json").read_text())["count"] == 3
        sizes = shard_sizes(out)
        assert sum(b for b, *_ in sizes.values()) == 3
        made, file = next(iter(Stream(TINY, 2))), next(iter(sizes))
        for i in range(2):
            read = read_sample(file, i)
            assert torch.allclose(read.images[0], made.images[i], atol=1e-5)
            assert torch.allclose(read.normals[0], made.normals[i], atol=1e-4)
            assert torch.equal(read.lights[0], made.lights[i])
            assert torch.equal(read.mask[0], made.mask[i])
    elif layout == "diligent":
        folders = sorted(p for p in out.iterdir() if p.is_dir())
        assert len(folders) == 3
        assert pn.load(folders[2]).images.shape == (5, 48, 48, 3)
    else:
        assert len(listed_samples(out)) == 3


def test_what_cannot_be_written_is_refused_and_nothing_is_left(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="isn't an empty folder"):
        render(TINY, 1, tmp_path / "full")
    with pytest.raises(InputError, match="no layout 'zip'"):
        render(TINY, 1, tmp_path / "out", layout="zip")
    with pytest.raises(InputError, match="at least one is needed"):
        render(TINY, 0, tmp_path / "out")
    with pytest.raises(InputError, match="no recipe 'demos'"):
        render("demos", 1, tmp_path / "out")

    def stop(done: int, count: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(TINY, 2, tmp_path / "out", progress=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["full"]


def test_a_folder_without_shards_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"holds no \.safetensors"):
        shard_sizes(tmp_path)
    (tmp_path / "0.safetensors").write_bytes(b"not a shard at all")
    with pytest.raises(InputError, match="not a shard"):
        shard_sizes(tmp_path)
    tensors = {"images": torch.zeros(2, 4, 3, 8, 8), "lights": torch.zeros(2, 4, 3)}
    tensors |= {"normals": torch.zeros(2, 3, 8, 8, dtype=torch.int16), "mask": torch.ones(2, 1, 8, 8).byte()}
    for wrong in (tensors["images"], tensors["images"][:, :3].to(torch.uint16), tensors["images"][0].to(torch.uint16)):
        save_file(tensors | {"images": wrong.contiguous()}, tmp_path / "0.safetensors")
        with pytest.raises(InputError, match=r"not a shard of a rendered set \(it holds images"):
            shard_sizes(tmp_path)


def test_the_shipped_demonstration_is_hard_and_what_its_recipe_renders(tmp_path):
    from importlib.resources import files

    shipped = pn.load(str(files("photonormal") / "data" / "demo"))
    assert shipped.images.shape == (24, 160, 160, 3)
    assert 8 < pn.score(pn.solve(shipped, "woodham"), shipped.truth).mean_deg < 25
    made = pn.load(render("demo", 1, tmp_path / "out") / "demo_0001")
    assert (made.mask == shipped.mask).mean() > 0.999
    both = made.mask & shipped.mask
    assert (np.abs(made.truth.map - shipped.truth.map)[both] < 1e-2).mean() > 0.999
    assert np.abs(made.images[3] - shipped.images[3])[both].mean() < 0.01
