import numpy as np
import pytest

from photonormal import progress
from photonormal.batch import workers
from photonormal.batch.work import work
from photonormal.cli import main
from tests.scenes import lambertian, ring, sphere, write_diligent

WORDS = ("--method", "woodham", "--no-mesh", "--no-expected-error")  # what takes least


@pytest.fixture
def season(tmp_path):
    """Three captures of matt spheres."""
    for k in range(3):
        write_diligent(tmp_path / "season" / f"vase-{k}", lambertian(sphere(24 + 4 * k), ring(5, 60)))
    return tmp_path / "season"


@pytest.fixture
def here(monkeypatch):
    """Captures are measured by this process: to start others takes seconds."""

    def run(waiting, at, begun, jobs):
        for named in waiting:
            begun(named.name, "here")
            yield work(named)

    monkeypatch.setattr(workers, "work_through", run)
    monkeypatch.setattr(workers, "begin_loading", lambda: None)


@pytest.fixture
def batch(tmp_path, capsys, monkeypatch):
    """Run the command over captures into `results`; gives its code, and what it printed."""

    monkeypatch.setattr(progress, "EVERY", 3600.0)  # no line of how far it is, however busy the machine

    def run(*words, captures=None, command="batch") -> tuple[int, str, str]:
        captures = [tmp_path / "season" / "*"] if captures is None else captures
        here = [] if {"--scheduler", "--workers"} & set(words) else ["--jobs", "1"]
        given = [command, *captures, "--out", tmp_path / "results", *WORDS, *here, *words]
        code = main([str(word) for word in given])
        return code, *capsys.readouterr()

    return run


def cut(picture):
    """Leave half of a file."""
    picture.write_bytes(picture.read_bytes()[: picture.stat().st_size // 2])


def normals(results, name):
    with np.load(results / name / "normals.npz") as data:
        return data["normals"]
