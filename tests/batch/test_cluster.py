"""Captures measured by the workers of a Dask cluster."""

import json
import subprocess
import sys
import threading
from pathlib import Path
from socketserver import BaseRequestHandler, ThreadingTCPServer

import numpy as np
import pytest

import photonormal as pn
from photonormal import progress, resources
from photonormal.batch import cluster
from photonormal.batch.captures import jobs
from photonormal.batch.state import state_of
from photonormal.disk import at_once
from photonormal.job import Job, carry_out, solve_part
from photonormal.methods.engine import parts
from photonormal.provenance import ProgramVersion, program
from photonormal.types import InputError
from tests.batch.conftest import WORDS, cut, normals
from tests.scenes import lambertian, ring, sphere, write_diligent

pytest.importorskip("distributed")
COMMAND = [sys.executable, "-c", "import sys; from photonormal_command import main; sys.exit(main())"]


def test_workers_of_this_machine_measure_what_processes_do(season, tmp_path):
    cut(season / "vase-1" / "003.png")
    words = ["batch", "season/*", "--out", "results", *WORDS, "--workers", "1", "--json-lines"]
    done = subprocess.run([*COMMAND, *words], cwd=tmp_path, capture_output=True, text=True)
    said = [line for line in done.stderr.splitlines() if "3 captures: " not in line]  # how far it is, on a busy machine
    assert (done.returncode, said) == (1, [])
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


def test_an_address_of_something_else_is_one_line(season, batch):
    class Page(BaseRequestHandler):
        def handle(self) -> None:
            self.request.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
            self.request.recv(2**16)  # until the other has seen it

    with ThreadingTCPServer(("127.0.0.1", 0), Page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        code, out, err = batch("--scheduler", f"tcp://127.0.0.1:{server.server_address[1]}")
        server.shutdown()
    assert (code, out, err.count("\n")) == (2, "", 1) and "no Dask scheduler; check its address and port" in err


@pytest.mark.parametrize("broken", [False, True])
def test_the_rows_of_a_large_capture_are_solved_by_all_workers(tmp_path, monkeypatch, broken):
    from distributed import Client

    monkeypatch.setattr(parts, "STEP", 16)
    monkeypatch.setattr(parts, "LEAST", 16)
    monkeypatch.setattr(progress, "_told", None)
    monkeypatch.setattr(resources, "_share", None)
    solved, threads = [], []
    monkeypatch.setattr(cluster, "use_threads", threads.append)
    monkeypatch.setattr(cluster, "_own_threads", lambda: 1)
    monkeypatch.setattr(cluster, "solve_part", lambda job, rows: solved.append(rows) or solve_part(job, rows))
    write_diligent(tmp_path / "vase", lambertian(sphere(64), ring(5, 60)))
    if broken:
        cut(tmp_path / "vase" / "003.png")
    (found,), _ = jobs([str(tmp_path / "vase")], tmp_path / "results", Job(Path(), Path(), method="trimmed"), {})
    begun = []
    with Client(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as client:
        (outcome,) = cluster._run(client, 0, 0.001, [found], lambda *_: None, lambda *words: begun.append(words))
    assert sorted(rows.start for rows in solved) == [0, 37] and outcome.name == "vase"  # 32 below the top of the sphere
    assert threads == [1, 1, 1, 2]  # the last with those of all, which have nothing to do
    if broken:  # it is measured by one, as if it were small, and its files are known
        assert outcome.kind == "input" and "003.png is truncated" in outcome.failure
        assert state_of(found.job).kind == "failed"
        return
    whole = pn.solve(pn.load(tmp_path / "vase"), "trimmed")
    assert np.abs(normals(tmp_path / "results", "vase") - whole.map).max() < 1e-6
    assert state_of(found.job).kind == "done"


def test_captures_are_shared_by_the_workers_of_a_cluster_alone(season, tmp_path, batch):
    code, out, err = batch("--split-megapixels", "10")
    assert (code, out, err.count("\n")) == (2, "", 1) and "needs a cluster" in err
    code, out, err = batch("--workers", "2", "--jobs", "2")
    assert (code, out, err.count("\n")) == (2, "", 1) and "leave --jobs out" in err


class Workers:
    """A cluster whose workers differ."""

    def run(self, function, on_error):
        there = {"a": program(), "b": ProgramVersion("0.0.1", "1"), "c": ProgramVersion(pn.__version__, "1")}
        failed = {"d": ModuleNotFoundError("photonormal"), "e": ConnectionResetError("it has just ended")}
        return there | failed | {"f": AttributeError("program")}


def test_workers_of_another_version_or_other_code_are_named():
    there = f"b has 0.0.1, c has {pn.__version__} with other code or weights, d has none, f has one that can't be asked"
    with pytest.raises(InputError, match=f"another: {there}; install the same everywhere"):
        cluster._refuse_others(Workers())


def test_what_workers_end_without_a_scheduler_is_told(season, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "ALONE_S", 0.0)
    named, _ = jobs([str(season / "*")], tmp_path / "results", Job(Path(), Path(), method="woodham"), {})
    carry_out(named[1].job)
    with at_once(named[2].job.out):
        assert [outcome.name for outcome in cluster._ended_alone([(n, 0.0) for n in named])] == ["vase-1"]
