"""Learning from sets on disk: the same contract as the rendered stream, the set's own split, and what is refused."""

import itertools
import json
import shutil
from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from photonormal.capture.augmentation import LIMIT, NOISE, augmented
from photonormal.cli import main
from photonormal.methods.learned.weights import load_network
from photonormal.synth import render
from photonormal.synth.recipes import recipe as rendering
from photonormal.train import checkpoint, disk, loop, sets, validate
from photonormal.train.disk import Disk
from photonormal.train.recipes import RECIPES, Recipe
from photonormal.types import InputError
from tests.scenes import lambertian, ring, sphere, write_diligent
from tests.train.published import PICTURES, SIDE, directions, write_sample, write_set
from tests.train.toy import Toy

CPU = torch.device("cpu")
RECIPE = Recipe(
    config={"width": 8}, rendering={"crop": 16}, images=(4, 5), batch=4, steps=8, warmup=2, lr=1e-3,
    schedule="cosine", clip=1.0, turns=True, reuse=2, ring=3, validate=4,
)  # fmt: skip


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.delenv("PHOTONORMAL_DATA", raising=False)
    monkeypatch.setattr(validate, "BATCHES", 1)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def root(tmp_path):
    return write_set(tmp_path / "Blobs")


def batches(root, count, start_step=0, seed=3, batch=4, recipe=RECIPE):
    return list(itertools.islice(Disk([root], recipe).stream("train", batch, CPU, seed, start_step), count))


def assert_same(a, b):
    for x, y in zip(vars(a).values(), vars(b).values(), strict=True):
        torch.testing.assert_close(x, y, atol=0, rtol=0)


def test_a_batch_depends_on_seed_and_step_alone(root, monkeypatch):
    whole = batches(root, 5)
    for step in (1, 4):
        assert_same(batches(root, 1, start_step=step)[0], whole[step])
    assert not torch.equal(batches(root, 1, seed=4)[0].images, whole[0].images)
    monkeypatch.setattr(disk, "KEPT_BYTES", 3 * SIDE * SIDE * 3 * PICTURES)  # room for few samples: read again
    monkeypatch.setattr(disk, "cores", lambda: 3)
    for a, b in zip(batches(root, 5), whole, strict=True):
        assert_same(a, b)


def test_a_window_is_a_matt_one_of_the_set(root):
    """Unit normals on the mask, nothing outside, the lights of the list; shading is n.l to the noise that is added."""
    listed, compared = np.concatenate([directions(seed) for seed in range(7)]), 0
    for batch in batches(root, 4):
        b, n, _, h, w = batch.images.shape
        assert (b, n, h, w) == (4, 5, 16, 16) and batch.mask.any(-1).any(-1).all()
        torch.testing.assert_close(batch.normals.norm(dim=1), batch.mask[:, 0].float(), atol=1e-5, rtol=0)
        assert not (batch.images * ~batch.mask[:, None]).any()
        assert batch.images.max() <= LIMIT + NOISE and batch.images.min() >= -NOISE
        for l in batch.lights.flatten(0, 1).numpy():
            assert np.abs(listed - l).sum(1).min() < 2e-3
        albedo = torch.tensor([0.5, 0.7, 0.9]).view(3, 1, 1)
        matt = torch.einsum("bnc,bchw->bnhw", batch.lights, batch.normals)[:, :, None] * albedo
        inner = torch.nn.functional.avg_pool2d(batch.mask.float(), 7, 1, 3) > 0.99  # away from where both sides mix
        for image, expected, within in zip(batch.images, matt, inner, strict=True):
            sure = (within & (expected > 0.2) & (image < LIMIT - 0.1)).expand_as(image)
            if sure.sum() > 50:
                gain = image[sure] / expected[sure]
                assert 0.95 < gain.median() < 3.05 and (gain / gain.median() - 1).abs().median() < 0.05
                compared += 1
    assert compared > 4


def test_windows_differ_in_scale_and_place(root):
    sizes = {int(batch.mask[i].sum()) for batch in batches(root, 4) for i in range(4)}
    assert len(sizes) > 10


def test_every_sample_comes_once_an_epoch(root, monkeypatch):
    monkeypatch.setattr(Disk, "window", lambda self, s, key, g: key)
    monkeypatch.setattr(disk, "stacked", lambda windows, device: windows)
    seen = list(itertools.chain.from_iterable(batches(root, 7, batch=4)))
    trained = (root / "train_mtrl.txt").read_text().split()
    for epoch in range(4):
        assert Counter(seen[7 * epoch : 7 * epoch + 7]) == Counter(trained)
    assert seen[:7] != seen[7:14]


def test_the_split_is_the_set_s_own(root, monkeypatch):
    trained, kept = ((root / name).read_text().split() for name in ("train_mtrl.txt", "val_mtrl.txt"))
    seen = []
    monkeypatch.setattr(Disk, "window", lambda self, s, key, g: seen.append(key))
    monkeypatch.setattr(disk, "stacked", lambda windows, device: windows)
    batches(root, 10)
    assert set(seen) == set(trained)
    seen.clear()
    exams = Disk([root], RECIPE).exams(4, CPU)
    assert sorted(seen) == sorted(kept) and list(exams) == ["blobby-paper"]


def test_lists_that_windows_wrote_are_the_same(root):
    names = Disk([root], RECIPE).sets[0].training
    edit(root / "train_mtrl.txt", lambda t: t.replace("/", "\\").replace("\n", "\r\n\r\n"))
    assert Disk([root], RECIPE).sets[0].training == names
    Disk([root], RECIPE).check()


def test_a_grey_map_of_normals_is_named(root):
    path = root / "Images" / "blob01" / "blob01_normal.png"
    cv2.imwrite(str(path), cv2.imread(str(path))[..., 0])
    with pytest.raises(InputError, match=r"blob01_normal\.png is grey but normals have three channels"):
        Disk([root], RECIPE).sets[0].read(SAMPLE)


def test_two_sets_are_learned_from_in_the_proportion_of_their_samples(root, tmp_path, monkeypatch):
    other = write_set(tmp_path / "Sculptures", training=14, validation=1)
    monkeypatch.setattr(Disk, "window", lambda self, s, key, g: s.name)
    monkeypatch.setattr(disk, "stacked", lambda windows, device: windows)
    assert Counter(next(Disk([root, other], RECIPE).stream("train", 21, CPU, 0))) == {"Blobs": 7, "Sculptures": 14}


def run(out, root, recipe=RECIPE, **options):
    return loop.train(recipe, out, device="cpu", stream=Toy, data=[root], **options)


def test_a_training_stopped_and_resumed_equals_one_that_was_not(root, tmp_path, monkeypatch):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    run(whole, root)

    class Stopped(Exception):
        pass

    stream = Disk.stream

    def broken(self, *given, **named):
        yield from itertools.islice(stream(self, *given, **named), 5)
        raise Stopped

    with monkeypatch.context() as m, pytest.raises(Stopped):
        m.setattr(Disk, "stream", broken)
        run(parts, root, save_seconds=0)
    assert torch.load(parts / checkpoint.NAME, weights_only=True)["step"] == 5
    run(parts, root, resume=True)
    a, b = (torch.load(x / checkpoint.NAME, weights_only=True) for x in (whole, parts))
    assert a["step"] == b["step"] == 8
    for k in a["network"]:
        torch.testing.assert_close(a["network"][k], b["network"][k], atol=0, rtol=0)


def test_card_journal_and_checkpoint_say_what_was_learned_from(root, tmp_path):
    path = run(tmp_path / "out", root, replace(RECIPE, steps=2))
    card = path.with_suffix(".md").read_text()
    assert "sets on disk: Blobs (blobby, 7 samples" in card and f"--data {root}" in card
    assert "## Validation samples of the sets on disk" in card
    kinds = {json.loads(line)["kind"] for line in (tmp_path / "out" / "journal.jsonl").read_text().splitlines()}
    assert {"train", "clean", "hemisphere", "blobby-paper"} <= kinds
    load_network(path)
    told = torch.load(tmp_path / "out" / checkpoint.NAME, weights_only=True)["data"]
    assert [(s["name"], s["training"], s["validation"]) for s in told] == [("Blobs", 7, 2)]


def test_other_data_is_refused_on_resuming(root, tmp_path):
    out, other = tmp_path / "out", write_set(tmp_path / "Others", training=3)
    run(out, root, steps=2)
    with pytest.raises(InputError, match="learned from Blobs but Others came"):
        run(out, other, steps=4, resume=True)
    with pytest.raises(InputError, match="learned from Blobs but rendered scenes came"):
        loop.train(replace(RECIPE, reuse=1), out, steps=4, device="cpu", stream=Toy, resume=True)
    shutil.move(root, tmp_path / "moved" / "Blobs")  # where a set lies does not matter
    run(out, tmp_path / "moved" / "Blobs", steps=4, resume=True)


def test_shards_and_objects_are_learned_from_too(tmp_path):
    made = rendering("lambert", crop=16, crops=4, size=48, scenes=2, lights=(6, 6), zoom=0.3)
    shards = render(made, 6, tmp_path / "shards", layout="shards")
    for name in ("ball", "egg"):
        write_diligent(tmp_path / "objects" / f"{name}PNG", lambertian(sphere(32), ring(6)))
    for root, count in ((shards, 6), (tmp_path / "objects", 2), (tmp_path / "objects" / "eggPNG", 1)):
        held = Disk([root], RECIPE)
        assert sum(len(s.training) for s in held.sets) == count and not held.exams(4, CPU)
        batch = next(held.stream("train", 4, CPU, 0))
        assert batch.images.shape == (4, 5, 3, 16, 16)
        if root != shards:  # albedo 0.7
            matt = 0.7 * torch.einsum("bnc,bchw->bnhw", batch.lights, batch.normals)[:, :, None]
            assert (batch.images - matt)[:, :, :1][batch.mask[:, None].expand_as(matt)].abs().median() < 0.01
        assert batch.images.min() >= 0 and batch.images.max() <= 1  # as they are: no gain, no noise
    whole = Disk([shards], replace(RECIPE, images=(4, 6)))
    key = whole.sets[0].training[3]
    written = whole.sets[0].read(key)
    window = augmented(written, np.random.default_rng(0), 6, 16, exposed=False)
    order = [int(np.abs(written.lights - l).sum(1).argmin()) for l in window.lights]
    np.testing.assert_array_equal(window.images, np.asarray(written.images)[order])  # of the window's size already


SAMPLE = "blob01/matt-3"


def folder(root):
    return root / "Images" / SAMPLE


def a_picture(root):
    return sorted(folder(root).glob("*.png"))[2]


def edit(path, change):
    path.write_text(change(path.read_text()))


BROKEN = {
    "no list of training": (lambda r: (r / "train_mtrl.txt").unlink(), "has no train_mtrl.txt"),
    "no list of validation": (lambda r: (r / "val_mtrl.txt").unlink(), "has no val_mtrl.txt"),
    "an empty list": (lambda r: (r / "train_mtrl.txt").write_text(""), "lists no sample"),
    "a picture is missing": (lambda r: a_picture(r).unlink(), "matt-3.* is missing"),
    "no list of lights": (lambda r: (folder(r) / "blob01_matt-3.txt").unlink(), "blob01_matt-3.txt is missing"),
    "a light is missing": (
        lambda r: edit(folder(r) / "blob01_matt-3.txt", lambda t: "\n".join(t.splitlines()[:-1])),
        f"sample {SAMPLE} .* has 5 pictures .* others have 6",
    ),
    "a light is zero": (
        lambda r: edit(folder(r) / "blob01_matt-3.txt", lambda t: t.splitlines()[0].split()[0] + " 0 0 0\n"),
        "the light of .*matt-3.* is no direction",
    ),
    "a line is broken": (
        lambda r: edit(folder(r) / "blob01_matt-3.txt", lambda t: t + "one.png 0 0\n"),
        "line 7 of .*blob01_matt-3.txt",
    ),
    "more than a light": (
        lambda r: edit(folder(r) / "blob01_matt-3.txt", lambda t: t.replace("\n", " 1.0\n")),
        "blob01_matt-3.txt has more than `picture x y z` after blob01_matt-3_l_",
    ),
    "no normals": (lambda r: (folder(r).parent / "blob01_normal.png").unlink(), "blob01_normal.png is missing"),
    "another size": (
        lambda r: shutil.copy(write_sample(r, "x", "y", 0, side=20).parent / "x_normal.png", a_picture(r)),
        "has 20 x 20 pixels",
    ),
    "a sample of another size": (
        lambda r: (
            (shutil.rmtree(r / "Images" / "blob02"), write_sample(r, "blob02", "matt-4", 4, side=32))
            and edit(r / "train_mtrl.txt", lambda t: t.replace("blob02/matt-5\n", ""))
        ),
        "sample blob02/matt-4 .* has 6 pictures of 32 x 32 pixels but others have 6 of 40 x 40",
    ),
    "an absent sample": (
        lambda r: edit(r / "val_mtrl.txt", lambda t: t + "blob09/gold\n"),
        "val_mtrl.txt names blob09/gold but",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_bad_sets_are_refused_in_one_line_before_anything_is_trained(root, tmp_path, case):
    spoil, message = BROKEN[case]
    spoil(root)
    with pytest.raises(InputError, match=message) as caught:
        run(tmp_path / "out", root)
    assert len(str(caught.value).splitlines()) == 1 and str(root) in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_picture_that_breaks_off_is_named(root, tmp_path):
    """Its header is whole: it shows when it is decoded."""
    a_picture(root).write_bytes(a_picture(root).read_bytes()[:-30])
    with pytest.raises(InputError, match=r"matt-3.* truncated") as caught:
        run(tmp_path / "out", root)
    assert len(str(caught.value).splitlines()) == 1


def test_sets_that_a_recipe_can_t_use(root, tmp_path):
    for recipe, message in (
        (replace(RECIPE, images=(8, 32)), "has 6 pictures but the recipe shows 8"),
        (replace(RECIPE, rendering={"crop": 48}), "has 40 x 40 pixels but the recipe's windows have 48 x 48"),
    ):
        with pytest.raises(InputError, match=message):
            Disk([root], recipe).check()
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no training set; give a Blobby or Sculpture set"):
        Disk([tmp_path / "empty"], RECIPE)
    with pytest.raises(InputError, match="is no folder but --data needs a set"):
        Disk([tmp_path / "nowhere"], RECIPE)
    write_diligent(tmp_path / "objects" / "ballPNG", replace(lambertian(sphere(32), ring(6)), truth=None))
    with pytest.raises(InputError, match=r"has no Normal_gt\.mat"):
        Disk([tmp_path / "objects"], RECIPE).check()


@pytest.mark.parametrize("changes", [{"network": "lightsnet", "config": {}}, {"lights": "sdps-lights"}], ids=str)
def test_lights_are_not_told_by_windows(root, tmp_path, changes):
    with pytest.raises(InputError, match="lights are learned from whole objects, of which it holds windows"):
        run(tmp_path / "out", root, recipe=replace(RECIPE, priors=(), **changes))
    assert not (tmp_path / "out").exists()


def test_how_many_samples_were_checked_is_told(root, caplog):
    with caplog.at_level("INFO", sets.log.name):
        Disk([root, root], RECIPE).check()
    assert "18 samples of 2 sets checked" in caplog.text


def test_from_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(RECIPES, "tiny", replace(RECIPE, steps=2))
    monkeypatch.setattr(loop, "rendered", lambda: Toy)
    a, b = (write_set(tmp_path / name, training=3, validation=1) for name in ("A", "B"))
    out = str(tmp_path / "out")
    assert main(["train", "tiny", "--out", out, "--device", "cpu", "--data", str(a), "--data", str(b)]) == 0
    assert "A (blobby, 3 samples" in (tmp_path / "out" / "tiny.md").read_text()
    (b / "val_mtrl.txt").unlink()
    capsys.readouterr()
    assert main(["train", "tiny", "--out", str(tmp_path / "other"), "--data", str(a), "--data", str(b)]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith("photonormal: ") and "val_mtrl.txt" in said and len(said.splitlines()) == 1
