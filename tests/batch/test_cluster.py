"""Captures measured by the workers of a Dask cluster."""

import json
import subprocess
import sys

import numpy as np
import pytest

import photonormal as pn
from photonormal.batch import cluster
from photonormal.types import InputError
from tests.batch.conftest import WORDS, cut, normals

pytest.importorskip("distributed")
COMMAND = [sys.executable, "-c", "import sys; from photonormal_command import main; sys.exit(main())"]


def test_workers_of_this_machine_measure_what_processes_do(season, tmp_path):
    cut(season / "vase-1" / "003.png")
    words = ["batch", "season/*", "--out", "results", *WORDS, "--workers", "1", "--json-lines"]
    done = subprocess.run([*COMMAND, *words], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "")
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert {e["capture"] for e in events if e["event"] == "done"} == {"vase-0", "vase-2"}
    assert [e["capture"] for e in events if e["event"] == "failed"] == ["vase-1"]
    assert all("tcp://127.0.0.1:" in e["where"] for e in events if e["event"] == "begun")
    expected = pn.solve(pn.load(season / "vase-2"), "woodham")
    assert np.array_equal(normals(tmp_path / "results", "vase-2"), expected.map)


def test_a_scheduler_that_does_not_answer_is_one_line(season, tmp_path, batch, monkeypatch):
    monkeypatch.setattr(cluster, "ANSWER_S", 0.5)
    code, out, err = batch("--scheduler", "tcp://127.0.0.1:1")
    assert (code, out, err.count("\n")) == (2, "", 1) and "tcp://127.0.0.1:1 does not answer within 0.5 s" in err
    assert "came but an address such as" in batch("--scheduler", "here")[2]
    assert not (tmp_path / "results").exists()


class Workers:
    """A cluster whose workers have several versions."""

    def run(self, function, on_error):
        there = {"tcp://a:1": pn.__version__, "tcp://b:1": "0.0.1", "tcp://c:1": ModuleNotFoundError("photonormal")}
        return there | {"tcp://d:1": ConnectionResetError("it has just ended")}


def test_workers_of_another_version_are_named():
    with pytest.raises(InputError, match=r"another version: tcp://b:1 0\.0\.1, tcp://c:1 none; install"):
        cluster._refuse_other_versions(Workers())
