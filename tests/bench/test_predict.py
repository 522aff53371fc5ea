"""`bench`: predictions that are stored once, completed after an interruption, and never mixed."""

import json
import shutil
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import torch

from photonormal.bench import bench, predict
from photonormal.bench.scores import all_scored
from photonormal.capture import load
from photonormal.export import load_normals
from photonormal.methods import METHODS, solve
from photonormal.methods.contract import Needs, Solution
from tests.scenes import lambertian, ring, sphere, write_diligent


def test_what_is_stored_is_what_solve_gives(root, runs):
    stored = load_normals(runs / "trimmed" / "diligent" / "ball.npz")
    expected = solve(load(root / "pmsData" / "ballPNG"), "trimmed")
    assert (stored.map == expected.map).all() and (stored.mask == expected.mask).all()


def test_a_draw_is_the_capture_with_those_images(root, runs):
    record = json.loads((runs / "woodham" / "diligent" / "cat@6-001.json").read_text())
    numbers = ",".join(name.removesuffix(".png") for name in record["images"])
    expected = solve(load(root / "pmsData" / "catPNG", images=numbers), "woodham")
    stored = load_normals(runs / "woodham" / "diligent" / "cat@6-001.npz")
    assert np.abs(stored.map - expected.map).max() < 5e-4  # half precision


def test_records_say_how_predictions_were_made(runs):
    config = json.loads((runs / "woodham" / "diligent" / "config.json").read_text())
    assert config["method"] == "woodham" and config["options"] == {} and config["weights_sha256"] is None
    record = json.loads((runs / "woodham" / "diligent" / "ball.json").read_text())
    assert record["images"] == [f"{j:03d}.png" for j in range(1, 13)]
    assert record["seconds"]["solve"] > 0 and record["seconds"]["read"] > 0 and record["device"]


def test_bear_is_predicted_without_its_first_twenty_pictures_too(runs):
    record = json.loads((runs / "woodham" / "diligent" / "bear@21-24.json").read_text())
    assert record["images"] == ["021.png", "022.png", "023.png", "024.png"]


def test_nothing_is_predicted_twice_and_what_is_lost_is_made_again(root, tmp_path, run):
    out = tmp_path / "runs"
    command = ("bench", "diligent", root, "--methods", "woodham", "--out", out)
    assert "4 predictions stored" in run(*command)[1]
    before = (out / "woodham/diligent/cat.npz").stat().st_mtime_ns
    (out / "woodham/diligent/ball.npz").unlink()
    code, printed, _ = run(*command)
    assert code == 0 and "1 predictions stored" in printed and "3 were there" in printed
    assert (out / "woodham/diligent/cat.npz").stat().st_mtime_ns == before


def test_an_interrupted_run_loses_only_the_object_it_was_on(root, tmp_path, monkeypatch):
    whole, out = predict.run_object, tmp_path / "runs"

    def interrupted(item, **how):
        if item.name == "cat":
            raise KeyboardInterrupt
        return whole(item, **how)

    monkeypatch.setattr(predict, "run_object", interrupted)
    with pytest.raises(KeyboardInterrupt):
        bench("diligent", root, out, methods="woodham")
    monkeypatch.undo()
    done = bench("diligent", root, out, methods="woodham")
    assert (done.predicted, done.kept) == (1, 3)


@pytest.mark.parametrize("lost", ["mask.png", "Normal_gt.mat", "light_directions.txt", "005.png"])
def test_an_object_with_a_missing_file_is_named_and_the_others_go_on(root, tmp_path, run, lost):
    copy = tmp_path / "root"
    shutil.copytree(root, copy)
    (copy / "pmsData" / "bearPNG" / lost).unlink()
    code, out, err = run("bench", "diligent", copy, "--methods", "woodham", "--out", tmp_path / "runs")
    assert code == 1 and "2 predictions stored" in out
    assert len(err.splitlines()) == 1 and "bear" in err and lost in err and "missing" in err


def test_a_method_that_fails_is_named_and_the_others_go_on(root, tmp_path, run, monkeypatch):
    from photonormal.methods.classical.trimmed import Trimmed

    def broken(*_):
        raise ZeroDivisionError("no window\nleft")

    monkeypatch.setattr(Trimmed, "__call__", broken)
    code, out, err = run("bench", "diligent", root, "--methods", "trimmed,woodham", "--out", tmp_path / "runs")
    assert code == 1 and "4 predictions stored" in out
    assert "diligent, ball: trimmed: ZeroDivisionError: no window left" in err and len(err.splitlines()) == 3


def test_absent_weights_are_named_and_the_others_go_on(root, tmp_path, run):
    methods = f"woodham,psfcn:weights={tmp_path / 'no.safetensors'}"
    code, out, err = run("bench", "diligent", root, "--methods", methods, "--out", tmp_path / "runs")
    assert code == 1 and "4 predictions stored" in out and "no.safetensors" in err


def test_objects_in_parallel_give_the_same(root, runs, tmp_path):
    out = tmp_path / "runs"
    done = bench("diligent", root, out, methods="woodham", objects="ball,cat", jobs=2)
    assert done.predicted == 2 and not done.failures
    for name in ("ball", "cat"):
        a, b = (load_normals(r / "woodham" / "diligent" / f"{name}.npz") for r in (out, runs))
        assert np.abs(a.map - b.map).max() < 1e-6


def test_a_fixed_file_chooses_images_for_each_object(root, tmp_path):
    (tmp_path / "mine.txt").write_text("ball: 1-4\ncat: 2,4,6,8  # every other\n")
    bench("diligent", root, tmp_path / "runs", methods="woodham", images="6", draws=0, fixed=(tmp_path / "mine.txt",))
    record = json.loads((tmp_path / "runs" / "woodham" / "diligent" / "cat@fixed-mine.json").read_text())
    assert record["images"] == ["002.png", "004.png", "006.png", "008.png"]
    assert not (tmp_path / "runs" / "woodham" / "diligent" / "bear@fixed-mine.npz").exists()


def test_errors_are_found_from_disk_and_again_when_a_prediction_changes(root, tmp_path):
    out = tmp_path / "runs"
    bench("diligent", root, out, methods="woodham", objects="ball")
    (before,) = all_scored(out)
    assert before.score["mean_deg"] < 3
    shutil.copy(out / "truth" / "diligent" / "ball.npz", tmp_path / "truth.npz")
    with np.load(tmp_path / "truth.npz") as truth:
        np.savez(out / "woodham" / "diligent" / "ball.npz", normals=truth["normals"], mask=truth["mask"])
    (after,) = all_scored(out)
    assert after.score["mean_deg"] == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("diligent", "EMPTY"), "holds no objects of diligent"),
        (("diligent", "ABSENT"), "is no folder"),
        (("nothing", "ROOT"), "no benchmark 'nothing'"),
        (("diligent", "ROOT", "--methods", "woodham,l1,woodham"), "two methods are called 'woodham'"),
        (("diligent", "ROOT", "--methods", "woodhan"), "no method 'woodhan'"),
        (("diligent", "ROOT", "--methods", "a=trimmed:low=1"), "trimmed has no option 'low'"),
        (("diligent", "ROOT", "--methods", "a=trimmed:least=x"), "give a whole number"),
        (("diligent", "ROOT", "--methods", "truth=woodham"), "can't be called 'truth'"),
        (("diligent", "ROOT", "--images", "two"), "--images 'two'"),
        (("diligent", "ROOT", "--objects", "horse"), "no object 'horse'"),
        (("diligent", "ROOT", "--draws", "-1"), "--draws -1"),
        (("diligent", "ROOT", "--jobs", "0"), "--jobs 0"),
        (("diligent", "ROOT", "--fixed", "ABSENT"), "can't be read"),
        (("diligent", "ROOT", "--device", "abacus"), "--device abacus came"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(root, tmp_path, run, arguments, says):
    (tmp_path / "empty").mkdir()
    places = {"EMPTY": tmp_path / "empty", "ABSENT": tmp_path / "absent", "ROOT": root}
    code, _, err = run("bench", *(places.get(a, a) for a in arguments), "--out", tmp_path / "runs")
    assert code == 2 and says in err and len(err.splitlines()) == 1
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("photonormal", "0.0.1", "version 0.0.1"),
        ("options", {"lowest": 0.5}, "options"),
        ("source_sha256", "0" * 64, "other code of the method"),
        ("layout", 0, "layout 0"),
    ],
)
def test_a_run_folder_from_another_version_is_refused(root, tmp_path, run, key, value, says):
    out = tmp_path / "runs"
    bench("diligent", root, out, methods="woodham", objects="ball")
    config = out / "woodham" / "diligent" / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {key: value}))
    code, _, err = run("bench", "diligent", root, "--methods", "woodham", "--out", out)
    assert code == 2 and says in err and str(out) in err and len(err.splitlines()) == 1


def test_one_method_enters_twice_under_two_names(root, tmp_path):
    out = tmp_path / "runs"
    bench("diligent", root, out, methods="trimmed,wide=trimmed:lowest=0.0:highest=1.0", objects="ball")
    config = json.loads((out / "wide" / "diligent" / "config.json").read_text())
    assert config["method"] == "trimmed" and config["options"]["highest"] == 1.0


def test_objects_may_be_called_as_our_own_files_are(root, tmp_path, run):
    for name in ("config", "scores", "a|b$c"):
        shutil.copytree(root / "pmsData" / "ballPNG", tmp_path / "set" / name)
    words = ("bench", "captures", tmp_path / "set", "--methods", "woodham", "--out", tmp_path / "runs")
    assert run(*words)[0] == 0 and "0 predictions stored" in run(*words)[1]
    for _ in range(2):  # errors are kept, too
        code, out, _ = run("table", tmp_path / "runs")
        assert code == 0 and "| method | a\\|b$c | config | scores | average of 3 |" in out
    assert r"method & a$|$b\$c & config & scores & average of 3 \\" in run("table", tmp_path / "runs", "--latex")[1]


def test_too_few_images_are_named(root, tmp_path, run):
    code, _, err = run("bench", "diligent", root, "--methods", "woodham", "--images", "20", "--out", tmp_path / "runs")
    assert code == 1 and "ball has 12 images but 20" in err and "bear" not in err


def test_objects_without_pictures_leave_no_trace_of_a_truth(tmp_path):
    write_diligent(tmp_path / "root" / "ballPNG", lambertian(sphere(32), ring(5)))
    (tmp_path / "root" / "ballPNG" / "001.png").write_bytes(b"broken")
    done = bench("diligent", tmp_path / "root", tmp_path / "runs", methods="woodham")
    assert len(done.failures) == 1 and not (tmp_path / "runs" / "truth").exists()


def test_what_every_method_stores_is_read_again():
    from photonormal.bench.store import Config
    from photonormal.methods import METHODS, configure, options_of
    from photonormal.stored import converted

    for name in METHODS:
        config = {"layout": 1, "photonormal": "0", "method": name, "options": options_of(configure(name))}
        assert converted(config, Config, name, "")["options"] == config["options"]


@dataclass(frozen=True)
class FindsLights:
    """A method that finds lights, and notes what it is shown."""

    needs: ClassVar[Needs] = Needs(lights=False, finds_lights=True, reads="object")
    shown: ClassVar[list] = []

    def __call__(self, seen):
        self.shown.append(seen)
        n = seen.I.shape[1]
        return Solution(torch.tensor([0.0, 0.0, 1.0]).expand(len(seen.I), 3), None, torch.eye(3)[torch.arange(n) % 3])


def test_a_method_that_finds_lights_is_shown_pictures_without_them(tmp_path, monkeypatch):
    monkeypatch.setitem(METHODS, "finds", f"{__name__}:FindsLights")
    folder = tmp_path / "pmsData" / "ballPNG"
    write_diligent(folder, lambertian(sphere(24), ring(9)))
    levels = []
    for e in (1.0, 2.0):
        np.savetxt(folder / "light_intensities.txt", np.full((10, 3), e))
        outcome = bench("diligent", tmp_path / "pmsData", tmp_path / f"runs{e}", methods="finds,woodham")
        assert outcome.predicted == 2 and not outcome.failures
        levels.append(FindsLights.shown[-1].I)
    assert FindsLights.shown[-1].L is None and torch.equal(*levels)
