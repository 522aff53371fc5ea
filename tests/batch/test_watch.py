"""Captures that come into a folder while it is watched."""

import csv
import shutil
from functools import partial

import pytest

from photonormal.batch import watch
from photonormal.cli import main
from photonormal.cli.batching import while_watching
from photonormal.types import InputError
from tests.batch.conftest import WORDS


class Camera:
    """What happens in the folder, one look after the other; a clock that goes a second a look."""

    def __init__(self, *happens):
        self.happens, self.seconds = list(happens), 0

    def stop(self):
        self.seconds += 1
        if not self.happens:
            return True
        self.happens.pop(0)()
        return False


def test_a_capture_is_given_when_its_last_file_has_stopped_growing(tmp_path, monkeypatch):
    capture, given = tmp_path / "in" / "vase", []
    (tmp_path / "in" / "results").mkdir(parents=True)
    (tmp_path / "in" / "results" / "1.png").write_text("a result")
    file = capture / "1.png"

    def nothing():
        pass

    camera = Camera(
        nothing,
        capture.mkdir,
        lambda: file.write_text("1"),
        nothing,
        lambda: file.write_text("12"),
        nothing,
        nothing,  # as it was for two seconds
        lambda: given.append("later"),
        nothing,
        lambda: (capture / "2.png").write_text("1"),
        nothing,
        nothing,
        nothing,
    )
    monkeypatch.setattr(watch.time, "monotonic", lambda: camera.seconds)
    monkeypatch.setattr(watch.time, "sleep", lambda seconds: None)
    watch.watch(tmp_path / "in", tmp_path / "in" / "results", given.append, 2, camera.stop)
    assert given == [[capture], "later", [capture]]


def test_pictures_that_lie_in_no_folder_are_told_once(tmp_path, monkeypatch, capsys):
    told = []
    camera = Camera(
        *[lambda name=name: (tmp_path / name).write_text("1") for name in ("mask.png", "7.jpg", "8.jpg")], int
    )
    monkeypatch.setattr(watch.time, "sleep", lambda seconds: None)

    def tell(event, **what):
        told.append(event)
        while_watching(event, **what)

    watch.watch(tmp_path, tmp_path / "out", told.append, 1, camera.stop, tell)
    assert told == ["watching", "loose"]
    err = capsys.readouterr().err
    assert err.count("\n") == 2 and "7.jpg lies in" in err


def test_what_comes_is_measured_and_the_summary_follows(season, tmp_path, here, monkeypatch, capsys):
    inbox, results = tmp_path / "in", tmp_path / "results"
    inbox.mkdir()
    looks = iter([lambda: shutil.copytree(season / "vase-0", inbox / "a"), *[None] * 3])
    more = iter([lambda: shutil.copytree(season / "vase-1", inbox / "b"), *[None] * 3])

    def stop():
        for happens in (looks, more):
            if (happening := next(happens, "end")) != "end":
                if happening:
                    happening()
                return False
        return True

    monkeypatch.setattr(watch, "watch", partial(watch.watch, stop=stop))
    monkeypatch.setattr(watch, "EVERY_S", 0)
    assert main(["watch", str(inbox), "--out", str(results), "--settle", "1e-9", *WORDS]) == 0
    out = capsys.readouterr().out.splitlines()
    assert len(out) == 2 and out[0].startswith("a: ") and out[1].startswith("b: ") and out[1].endswith(" normals")
    with (results / "summary.csv").open(encoding="utf-8-sig", newline="") as file:
        assert [(row["capture"], row["state"]) for row in csv.DictReader(file)] == [("a", "done"), ("b", "done")]


def test_a_folder_is_needed(tmp_path, capsys):
    assert main(["watch", str(tmp_path / "in"), "--out", str(tmp_path / "results")]) == 2
    assert "is no folder but one that captures come into is needed" in capsys.readouterr().err
    assert main(["watch", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "is watched, and results in it would be taken for captures" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_a_folder_that_is_gone_ends_it(tmp_path):
    (tmp_path / "in").mkdir()
    with pytest.raises(InputError, match="is no longer there"):
        watch.watch(tmp_path / "in", tmp_path / "out", print, 1, stop=lambda: (tmp_path / "in").rmdir())
