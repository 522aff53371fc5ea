"""Training: it learns, it resumes as if it had never stopped, and two processes are one with the double batch."""

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from photonormal.methods.learned.network import PixelNetwork
from photonormal.methods.learned.weights import load_network
from photonormal.train import checkpoint, learner, loop, objective, validate
from photonormal.train.observe import Observed, observe
from photonormal.train.recipes import Recipe
from photonormal.types import InputError
from tests.scenes import ring
from tests.train.toy import Toy

TINY = Recipe(
    config={"width": 8}, images=(3, 5), batch=4, steps=12, warmup=4, schedule="cosine", clip=1.0, ema=0.9,
    turns=True, reuse=2, ring=3, validate=6,
)  # fmt: skip
SMALL = {"hidden": 16, "features": 16, "width": 16}  # of normalnet
PLAIN: Any = SimpleNamespace(memory=0, teaches="")  # a network that tells normals alone
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.delenv("PHOTONORMAL_DATA", raising=False)
    monkeypatch.setattr(validate, "BATCHES", 2)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def run(out, recipe=TINY, **options):
    return loop.train(recipe, out, device="cpu", stream=Toy, **options)


def journal(out):
    return [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()]


def same(a, b):
    a, b = (torch.load(x / checkpoint.NAME, weights_only=True) for x in (a, b))
    assert a["step"] == b["step"]
    for part in ("network", "mean"):
        for k in a[part]:
            torch.testing.assert_close(a[part][k], b[part][k], atol=0, rtol=0)


def test_a_network_of_lights_learns_in_the_same_loop(tmp_path):
    lights = {"network": "lightsnet", "config": {"width": 8}, "rendering": {"crop": 64}, "priors": ()}
    recipe = replace(TINY, **lights, images=(5, 5), lr=5e-3, intensities=(0.5, 2.0), steps=50, validate=100)
    net = load_network(run(tmp_path, recipe), "lightsnet")
    assert net.learns == "lights"
    first, last = (entry for entry in journal(tmp_path) if entry["kind"] == "train")
    assert last["loss"] < 0.9 * first["loss"] and "loss_angle_deg" not in last
    assert "| mean_deg | median_deg | intensity |" in (tmp_path / "lightsnet.md").read_text()


@pytest.mark.parametrize("network", ["cnn-ps", "lmps", "spline-net"])
def test_a_network_of_pixels_learns_from_some_of_them(network, tmp_path):
    config = {"side": 8, "grown": 4, "hidden": 32} | ({"width": 8, "blocks": 1} if network == "spline-net" else {})
    recipe = replace(TINY, network=network, config=config, priors=(), pixels=50, lr=3e-3, steps=60, validate=100)
    run(tmp_path, recipe)
    first, last = (entry for entry in journal(tmp_path) if entry["kind"] == "train")
    assert last["loss"] < 0.9 * first["loss"]
    assert isinstance(load_network(tmp_path / f"{network}.safetensors", network), PixelNetwork)


def test_a_network_for_a_rig_learns_its_lights_by_name(tmp_path):
    L = ring(5)
    (tmp_path / "rig.lp").write_text("6\n" + "".join(f"{j}.png {x} {y} {z}\n" for j, (x, y, z) in enumerate(L)))
    recipe = replace(
        TINY,
        network="dpsn",
        config={"width": 32},
        priors=(),
        pixels=50,
        turns=False,
        lr=3e-3,
        steps=60,
        validate=100,
        exams=("clean",),
    )
    path = run(tmp_path / "out", recipe, lights=tmp_path / "rig.lp", name="mine")
    net = load_network(path, "dpsn")
    np.testing.assert_allclose(net.config.lights, L, atol=1e-5)
    first, last = (entry for entry in journal(tmp_path / "out") if entry["kind"] == "train")
    assert last["loss"] < 0.9 * first["loss"]
    assert {e["kind"] for e in journal(tmp_path / "out")} == {"train", "clean"}
    card = path.with_suffix(".md").read_text()
    assert f"--lights {tmp_path / 'rig.lp'}" in card and '"rig": "6 lights, which the weights name"' in card
    with pytest.raises(InputError, match="name its lights with --lights"):
        run(tmp_path / "none", recipe)
    with pytest.raises(InputError, match="--data came but a network for one rig learns"):
        run(tmp_path / "none", recipe, lights=tmp_path / "rig.lp", data=[tmp_path])
    assert not (tmp_path / "none").exists()


def test_a_network_becomes_better_than_its_prior(tmp_path):
    """One that equals its prior looks plausible and has learned nothing."""
    recipe = Recipe(
        config={"width": 8, "exchange": False}, images=(6, 6), batch=8, steps=400, warmup=25, lr=3e-3,
        schedule="cosine", clip=1.0, validate=1000,
    )  # fmt: skip
    run(tmp_path, recipe)
    found = journal(tmp_path)[-1]
    assert found["mean_deg"] < 0.9 * found["prior_deg"], found
    net = load_network(tmp_path / "lambertian-prior.safetensors", "lambertian-prior")
    assert net.config.width == 8


def test_resumed_training_gives_the_same_numbers(tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    run(whole)
    run_steps(parts, 8)
    assert checkpoint.load(parts, TINY.as_dict())["step"] == 8
    run(parts, resume=True)
    same(whole, parts)
    a, b = ([e for e in journal(x) if e["kind"] == "clean"] for x in (whole, parts))
    assert [e["mean_deg"] for e in a] == [e["mean_deg"] for e in b]


def test_a_resumed_training_keeps_its_precision(tmp_path, monkeypatch):
    run_steps(tmp_path, 8, precision="bf16")
    assert checkpoint.load(tmp_path, TINY.as_dict())["precision"] == "bf16"
    with pytest.raises(InputError, match="--precision float32 came but this training computes in bf16"):
        run(tmp_path, resume=True, precision="float32")
    asked = []
    launched = loop.launched
    monkeypatch.setattr(loop, "launched", lambda *given, **more: asked.append(given[1]) or launched(*given, **more))
    run(tmp_path, resume=True)
    assert asked == ["bf16"] and "| learned in | bf16 |" in (tmp_path / "lambertian-prior.md").read_text()


@pytest.mark.parametrize("wrong", [{"steps": -1}, {"steps": 0}, {"minutes": -1.0}, {"minutes": float("nan")}], ids=str)
def test_no_training_without_a_step(tmp_path, wrong):
    with pytest.raises(InputError, match="came but"):
        run(tmp_path / "out", **wrong)
    assert not (tmp_path / "out").exists()


def test_a_moment_is_time_for_one_step(tmp_path):
    """Never a weights file of a network that has learned nothing."""
    run(tmp_path, minutes=1e-9)
    assert checkpoint.load(tmp_path, TINY.as_dict())["step"] == 1


class Huge:
    """Becomes a bytearray of 100 GB when it is unpickled, which torch's restricted reader allows."""

    def __reduce__(self):
        return bytearray, (10**11,)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    out = tmp_path_factory.mktemp("trained")
    run_steps(out, 2)
    return out


@pytest.mark.parametrize(
    "change",
    [
        lambda state: state.pop("step"),
        lambda state: state.update(step=-1),
        lambda state: state.update(recipe=[]),
        lambda state: state.update(network={}),
        lambda state: state.update(mean={k: v[:1] for k, v in state["mean"].items()}),
        lambda state: state.update(optimiser={"0": 1}),
        lambda state: state["optimiser"]["0"]["state"][0].update(exp_avg=torch.ones(7)),
        lambda state: state["optimiser"]["0"]["state"][0].update(exp_avg=torch.ones(1).expand(10**12)),
        lambda state: state.update(optimiser=Huge()),
    ],
)
def test_a_checkpoint_of_another_shape_is_refused_in_one_line(trained, tmp_path, change):
    state = torch.load(trained / checkpoint.NAME, weights_only=True)
    change(state)
    torch.save(state, tmp_path / checkpoint.NAME)
    before = (tmp_path / checkpoint.NAME).read_bytes()
    with pytest.raises(InputError, match=r"^checkpoint (in )?\S+ .*; start again\.$"):
        run(tmp_path, resume=True, steps=4)
    assert (tmp_path / checkpoint.NAME).read_bytes() == before


def test_a_flat_training_made_longer_is_what_a_longer_one_would_have_been(tmp_path):
    flat, longer, parts = replace(TINY, schedule="flat"), tmp_path / "longer", tmp_path / "parts"
    run(longer, flat, steps=24)
    run_steps(parts, 8, flat)  # of twelve: before its rate falls
    run(parts, flat, resume=True, steps=24)
    same(longer, parts)


@pytest.mark.parametrize(
    "changes",
    [
        {"loss": "chord"},
        {"passes": 2},
        {"passes": 2, "config": SMALL | {"memory": 4, "coarse": 1}},
        {"passes": 2, "once": 75, "config": SMALL | {"memory": 4, "coarse": 1}},
    ],
    ids=str,
)
def test_other_ways_of_learning_are_better_than_the_prior_too(tmp_path, changes):
    more: dict = {"config": SMALL} | changes
    recipe = Recipe(
        network="normalnet", images=(6, 6), batch=8, steps=150, warmup=10, lr=5e-3, schedule="cosine", clip=1.0,
        validate=1000, **more,
    )  # fmt: skip
    run(tmp_path, recipe)
    found = journal(tmp_path)[-1]
    assert found["mean_deg"] < 0.9 * found["prior_deg"], found


@pytest.mark.parametrize(
    ("network", "config"),
    [
        ("gps-net", {"filters": 8, "order": 8, "width": 8}),
        ("attention-psn", {"width": 8, "shallow": 1, "deep": 1}),
        ("dr-psn", {"width": 8, "rendered": 2}),
    ],
)
def test_the_networks_of_the_tables_learn_in_the_same_loop(tmp_path, network, config):
    recipe = replace(TINY, network=network, config=config, images=(5, 5), priors=(), lr=5e-3, steps=60, validate=100)
    net = load_network(run(tmp_path, recipe), network)
    first, last = (entry for entry in journal(tmp_path) if entry["kind"] == "train")
    assert last["loss"] < first["loss"] and net.config.width == 8


def test_edges_are_learned_from_changes_and_all_else_from_normals():
    g = torch.Generator().manual_seed(0)
    truth, e = torch.randn(2, 3, 6, 7, generator=g), torch.rand(2, 6, 7, generator=g)
    none, all_ = torch.zeros(2, 6, 7), torch.ones(2, 6, 7)
    wrong = truth + torch.randn(truth.shape, generator=g)
    torch.testing.assert_close(objective.attended(e, wrong, truth, none), objective.EVEN * e)
    inside = objective.attended(e, truth + 0.5, truth, all_)[:, 1:-1, 1:-1]
    torch.testing.assert_close(inside, torch.zeros_like(inside))  # all alike wrong: nothing changes otherwise
    assert (objective.attended(e, wrong, truth, all_) > 0).all()


def test_images_rendered_back_as_they_were_cost_nothing():
    images = torch.rand(2, 5, 3, 4, 4, generator=torch.Generator().manual_seed(0))
    first = images[:, :2].flatten(1, 2)  # two of the five
    assert not objective.rendered_wrong(first, images).any()
    torch.testing.assert_close(objective.rendered_wrong(first + 0.5, images), torch.full((2, 4, 4), 0.25))


def test_a_chord_is_the_angle_where_it_is_small():
    class Fabric:
        all_reduce = staticmethod(lambda x, reduce_op: x)

    angle = torch.deg2rad(torch.tensor([0.0, 10.0, 60.0]))
    N = torch.stack([angle.sin(), 0 * angle, angle.cos()])[None, :, None]  # (1, 3, 1, 3)
    truth = torch.tensor([0.0, 0, 1])[None, :, None, None].expand_as(N)
    recipe = Recipe(loss="chord")
    for i, deg in enumerate([0.0, 10.0, 60.0]):
        mask = torch.zeros(1, 1, 1, 3, dtype=torch.bool)
        mask[..., i] = True
        seen = Observed(N, N, N, truth, mask, N)
        found = float(objective.of_normals(lambda images, *rest: images, PLAIN, seen, recipe, 1, Fabric))
        chord = 2 * np.sin(np.radians(deg) / 2)
        assert found == pytest.approx(np.hypot(chord, objective.CLOSE) - objective.CLOSE, abs=1e-4)


def test_expected_errors_are_learned_on_top_and_are_right_on_average(tmp_path):
    plainest = SMALL | {"memory": 0, "coarse": 0, "far": 0, "attention": 0, "level": False, "compass": False}
    silent = plainest | {"expected": False}
    recipe = Recipe(network="normalnet", config=silent, images=(6, 6), batch=8, steps=150, lr=5e-3, validate=1000)
    first = run(tmp_path / "first", recipe)
    told = replace(recipe, config=plainest, learn="doubt", lr=1e-2, steps=200)
    net, plain = load_network(run(tmp_path / "second", told, start_from=first)), load_network(first)
    batch = next(iter(Toy("", 16, "cpu", 99, lights=(6, 6))))
    seen = observe(batch, recipe, net.scaling, 0, vary=False)
    with torch.no_grad():
        found = net(seen.images, seen.lights, seen.prior)
        torch.testing.assert_close(found[:, :3], plain(seen.images, seen.lights, seen.prior)[:, :3])
    true = validate.errors_deg(found[:, :3], seen.normals, seen.mask)
    expected = found[:, -1][seen.mask[:, 0]]
    assert float(expected.mean()) == pytest.approx(float(true.mean()), rel=0.25)
    doubtful = expected > expected.median()
    assert true[doubtful].mean() > 1.1 * true[~doubtful].mean()


def test_a_training_can_begin_with_the_weights_of_another(tmp_path):
    first = run(tmp_path / "first", replace(TINY, steps=6))
    begun = run(tmp_path / "second", replace(TINY, lr=0.0, ema=0.0, seed=1), start_from=first)
    a, b = load_network(first), load_network(begun)
    for x, y in zip(a.parameters(), b.parameters(), strict=True):
        torch.testing.assert_close(x, y, atol=0, rtol=0)
    assert str(first) in begun.with_suffix(".md").read_text()
    with pytest.raises(InputError, match="but the recipe has"):
        run(tmp_path / "third", replace(TINY, config={"width": 8, "blocks": 3}), start_from=first)


def test_weights_may_go_half_of_the_way_from_those_they_began_with(tmp_path):
    first = run(tmp_path / "first", replace(TINY, steps=6))
    whole = load_network(run(tmp_path / "whole", replace(TINY, steps=6, seed=1), start_from=first))
    half = load_network(run(tmp_path / "half", replace(TINY, steps=6, seed=1, moved=0.5), start_from=first))
    for a, b, between in zip(*(net.parameters() for net in (load_network(first), whole, half)), strict=True):
        torch.testing.assert_close(between, (a + b) / 2, atol=1e-5, rtol=2**-7)  # written in bf16
    with pytest.raises(InputError, match="give --start-from FILE"):
        run(tmp_path / "none", replace(TINY, moved=0.5))
    with pytest.raises(InputError, match="a share above 0"):
        replace(TINY, moved=0.0)


def run_steps(out, steps, recipe=TINY, **options):
    """Train until the checkpoint after `steps`, then stop without warning."""

    class Stopped(Exception):
        pass

    class Broken(Toy):
        def __iter__(self):
            for i, batch in enumerate(super().__iter__()):
                if 2 * i == steps * recipe.accumulate and self.seed != validate.SEED:  # every batch is used twice
                    raise Stopped
                yield batch

    with pytest.raises(Stopped):
        loop.train(recipe, out, device="cpu", stream=Broken, save_seconds=0, **options)


def test_killed_training_resumes(tmp_path):
    """Killed by the system at no matter what moment."""
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    code = f"""
import torch
torch.set_num_threads(1)
from photonormal.train import loop, validate
from tests.train.test_loop import TINY
from tests.train.toy import Toy
from dataclasses import replace
validate.BATCHES = 2
loop.train(replace(TINY, steps=10**6), {str(killed)!r}, device="cpu", stream=Toy, save_seconds=0)
"""
    process = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE)
    try:
        deadline = time.monotonic() + 120
        while not (killed / checkpoint.NAME).exists():
            assert process.poll() is None, process.stderr.read().decode()
            assert time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stderr.close()
    long = replace(TINY, steps=10**6)
    step = checkpoint.load(killed, long.as_dict())["step"]
    run(killed, long, resume=True, steps=step + 3)
    run(whole, long, steps=step + 3)
    same_but_for_the_schedule(killed, whole)


def same_but_for_the_schedule(a, b):
    """The rate follows the length of the training, which was another before the kill: to a millionth."""
    a, b = (torch.load(x / checkpoint.NAME, weights_only=True) for x in (a, b))
    assert a["step"] == b["step"]
    for k in a["network"]:
        torch.testing.assert_close(a["network"][k], b["network"][k], atol=0.02, rtol=0.1)


def test_minutes_end_a_training_annealed(tmp_path, monkeypatch):
    ticks = itertools.count()
    monkeypatch.setattr(loop, "time", SimpleNamespace(monotonic=lambda: next(ticks) / 50))  # a clock of its own
    run(tmp_path, replace(TINY, steps=10**7, warmup=0), minutes=0.05)
    rates = [e["lr"] for e in journal(tmp_path) if e["kind"] == "train"]
    state = torch.load(tmp_path / checkpoint.NAME, weights_only=True)
    assert state["step"] < 10**6
    assert state["optimiser"]["0"]["param_groups"][0]["lr"] < 0.1 * rates[0]


def test_slow_steps_end_with_their_minutes(tmp_path):
    """Each takes some seconds: the clock is looked at before every one, and not every ten."""
    ticks = itertools.count()
    run(tmp_path, replace(TINY, warmup=0), minutes=0.1, clock=lambda: 2.0 * next(ticks))
    assert checkpoint.load(tmp_path, replace(TINY, warmup=0).as_dict())["step"] == 2


def test_what_is_there_is_not_overwritten(tmp_path):
    run(tmp_path, replace(TINY, steps=1))
    with pytest.raises(InputError, match="already holds a training; resume it with --resume"):
        run(tmp_path)
    with pytest.raises(InputError, match="has another batch than this recipe"):
        run(tmp_path, replace(TINY, steps=1, batch=6), resume=True)
    with pytest.raises(InputError, match=r"no checkpoint in .* to resume from"):
        run(tmp_path / "empty", resume=True)
    (tmp_path / checkpoint.NAME).write_bytes(b"PK half a file")
    with pytest.raises(InputError, match="can't be read"):
        run(tmp_path, replace(TINY, steps=1), resume=True)


def test_the_card_says_what_the_weights_are(tmp_path):
    path = run(tmp_path, replace(TINY, steps=2), name="mine")
    text = path.with_suffix(".md").read_text()
    for fact in (
        "lambertian-prior",
        "| seed | 0 |",
        "| steps | 2 of 4 samples |",
        "MIT",
        "--name mine",
        "mean_deg",
    ):
        assert fact in text
    load_network(path)  # the checksum on the card holds


WORKER = """
import sys, torch
torch.set_num_threads(1)
from photonormal.methods.learned import processor
from photonormal.methods.learned.network import placed
from photonormal.methods.learned.weights import build
from photonormal.train import learner, loop, objective
from photonormal.train.launch import launched
from photonormal.train.observe import observe
from photonormal.train.recipes import Recipe
from tests.train.toy import Batch, Toy

out, world = sys.argv[1], int(sys.argv[2])
processor.knows_bf16 = lambda kind: False
fabric = launched("cpu", "float32")
assert fabric.world_size == world
torch.manual_seed(0)
net = placed(build("lambertian-prior", {"width": 8}), "cpu")
model, optimiser = fabric.setup(net, torch.optim.SGD(net.parameters(), lr=0.1))
images, lights, normals, mask = next(iter(Toy("", 4, "cpu", 3)))
mask[:2, :, :9] = False  # the halves have different numbers of pixels
mine = slice(fabric.global_rank * 4 // world, (fabric.global_rank + 1) * 4 // world)
batch = Batch(*(x[mine] for x in (images * mask[:, None], lights, normals * mask, mask)))
recipe = Recipe(images=(5, 5))
seen = observe(batch, recipe, net.scaling, 0, vary=False)
loss = objective.of_normals(model, net, seen, recipe, 1, fabric)
fabric.backward(loss)
if fabric.global_rank == 0:
    torch.save({k: p.grad for k, p in net.named_parameters()}, out + f"/{world}.pt")
if world == 2:
    recipe = Recipe(config={"width": 8}, images=(5, 5), batch=4, steps=3)
    loop.train(recipe, out + "/ddp", device="cpu", stream=Toy)
    config = {"hidden": 16, "features": 16, "width": 16, "memory": 4}  # the memory is used from the second pass on
    recipe = Recipe(network="normalnet", config=config, images=(5, 5), batch=4, steps=4, passes=2, once=2)
    loop.train(recipe, out + "/once", device="cpu", stream=Toy)
"""


def test_two_processes_have_the_gradient_of_one_with_the_double_batch(tmp_path):
    script = tmp_path / "worker.py"
    script.write_text(WORKER)
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'src'}", "OMP_NUM_THREADS": "1"}
    environment.pop("PHOTONORMAL_DATA", None)
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    for start, world in (([sys.executable], 1), (torchrun, 2)):
        subprocess.run(
            [*start, str(script), str(tmp_path), str(world)],
            env=environment,
            check=True,
            capture_output=True,
            timeout=300,
        )
    one, two = (torch.load(tmp_path / f"{world}.pt", weights_only=True) for world in (1, 2))
    for k in one:
        torch.testing.assert_close(one[k], two[k], atol=1e-6, rtol=1e-4)
    assert (tmp_path / "ddp" / "lambertian-prior.safetensors").exists()
    assert (tmp_path / "once" / "normalnet.safetensors").exists()


def test_a_batch_without_a_finite_gradient_teaches_nothing(tmp_path, monkeypatch):
    error, calls = learner.error, itertools.count()
    monkeypatch.setattr(learner, "error", lambda *given: error(*given) * (torch.nan if next(calls) == 2 else 1))
    net = load_network(run(tmp_path))
    assert all(p.isfinite().all() for p in net.parameters())


def test_batches_whose_gradients_are_added_are_one_of_their_size(tmp_path):
    """The first step, of four toy scenes at once and of twice two, all pixels counting alike."""

    class Halves(Toy):
        """The scenes of Toy's first batch of four, two at a time."""

        def __iter__(self):
            whole = next(iter(Toy("", 4, self.device, self.seed, lights=(self.n, self.n), crop=self.side)))
            while True:
                yield type(whole)(*(x[:2] for x in whole))
                yield type(whole)(*(x[2:] for x in whole))

    at_once = replace(TINY, images=(5, 5), turns=False, gain=(1.0, 1.0), reuse=1, steps=1)
    loop.train(at_once, tmp_path / "whole", device="cpu", stream=Toy)
    parts = replace(at_once, batch=2, accumulate=2)
    loop.train(parts, tmp_path / "parts", device="cpu", stream=Halves)
    a, b = (torch.load(tmp_path / x / checkpoint.NAME, weights_only=True) for x in ("whole", "parts"))
    for k, w in a["network"].items():
        torch.testing.assert_close(w, b["network"][k], atol=2e-4, rtol=0)
    assert "1 of 4 samples" in (tmp_path / "parts" / "lambertian-prior.md").read_text()


def test_an_accumulated_training_resumes_as_if_it_had_never_stopped(tmp_path):
    recipe = replace(TINY, accumulate=3)
    loop.train(recipe, tmp_path / "whole", device="cpu", stream=Toy)
    run_steps(tmp_path / "parts", 6, recipe=recipe)
    run(tmp_path / "parts", recipe, resume=True)
    same(tmp_path / "whole", tmp_path / "parts")
