"""`photonormal batch`: each capture alone, nothing twice, and what is stale again."""

import csv
import json
import os
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal import disk
from photonormal.batch import run, state, workers
from photonormal.batch.work import work
from photonormal.cli import batching
from photonormal.disk import FileBatch
from photonormal.export.result import write_result
from tests.batch.conftest import cut, normals


def rows(results):
    with (results / "summary.csv").open(encoding="utf-8-sig", newline="") as file:
        return {row["capture"]: row for row in csv.DictReader(file)}


def times(results):
    return {p.parent.name: p.stat().st_mtime_ns for p in results.glob("*/normals.npz")}


def test_one_broken_capture_fails_alone_and_nothing_is_done_twice(season, tmp_path, batch):
    results = tmp_path / "results"
    cut(season / "vase-1" / "003.png")
    code, out, err = batch()
    assert (code, err.count("\n")) == (1, 1) and "vase-1: " in err and "003.png is truncated" in err
    assert "2 measured, 0 were done, 1 failed" in out
    expected = pn.solve(pn.load(season / "vase-2"), "woodham")
    assert np.array_equal(normals(results, "vase-2"), expected.map)
    found = rows(results)
    assert list(found) == ["vase-1", "vase-0", "vase-2"] and "truncated" in found["vase-1"]["failure"]
    assert found["vase-2"]["pixels"] == str(expected.mask.sum()) and found["vase-2"]["lights"] == "6"

    before = times(results)
    code, out, err = batch()
    assert code == 1 and "0 measured, 2 were done, 1 failed" in out and "003.png" in err
    assert times(results) == before
    shutil.copy(season / "vase-1" / "004.png", season / "vase-1" / "003.png")
    picture = season / "vase-1" / "003.png"
    write_again(picture)
    code, out, err = batch()  # its files are others now, so it is tried again by itself
    assert (code, err) == (0, "") and "1 measured, 2 were done" in out
    assert {row["state"] for row in rows(results).values()} == {"done"}
    assert "failed" not in json.loads((results / "vase-1" / "report.json").read_text())


def test_a_picture_that_was_missing_is_noticed_wherever_it_comes(season, tmp_path, here, batch):
    pictures = season / "vase-0" / "pictures"
    pictures.mkdir()
    for picture in (season / "vase-0").glob("0*.png"):
        picture.rename(pictures / picture.name)
    names = [f"pictures/{j + 1:03d}.png" for j in range(6)]
    (season / "vase-0" / "filenames.txt").write_text("\n".join(names))
    (pictures / "003.png").rename(tmp_path / "003.png")
    assert "2 measured, 0 were done, 1 failed" in batch()[1]
    assert "0 measured, 2 were done, 1 failed" in batch()[1]
    (tmp_path / "003.png").rename(pictures / "003.png")
    assert batch()[1].startswith("1 measured, 2 were done:")


def test_a_list_that_failed_is_tried_again_once_a_picture_that_it_names_is_there(season, tmp_path, here, batch):
    """Wherever that is: beside the list or not."""
    lights, pictures = pn.load(season / "vase-0").lights, sorted((season / "vase-0").glob("0*.png"))
    (tmp_path / "lists").mkdir()
    lines = [f"{p} {' '.join(map(str, v))}" for p, v in zip(pictures, lights, strict=True)]
    (tmp_path / "lists" / "a.lp").write_text("\n".join([str(len(lines)), *lines]))
    pictures[2].rename(tmp_path / "003.png")
    lists = [tmp_path / "lists" / "*.lp"]
    assert "0 measured, 0 were done, 1 failed" in batch(captures=lists)[1]
    report = tmp_path / "results" / "a" / "report.json"
    before = report.stat().st_mtime_ns
    code, out, err = batch(captures=lists)
    assert code == 1 and "0 measured, 0 were done, 1 failed" in out and err.startswith("photonormal: a: ")
    assert report.stat().st_mtime_ns == before  # it was not tried
    (tmp_path / "003.png").rename(pictures[2])
    assert batch(captures=lists)[1].startswith("1 measured")


def test_what_the_machine_was_too_small_for_is_tried_again(season, tmp_path, here, batch):
    captures = [season / "vase-0"]
    code, _, err = batch("--memory", "20KB", captures=captures)
    assert code == 1 and "24 x 24 pixels, would take 3.5 KB" in err and "--memory" in err
    assert batch("--memory", "3GB", captures=captures)[1].startswith("1 measured")


def test_a_fault_in_code_of_others_is_told_by_its_place(season, tmp_path, here, batch, monkeypatch):
    def broken(*given, **more):
        raise RuntimeError("no more film")

    monkeypatch.setattr("photonormal.job.write_result", broken)
    code, _, err = batch(captures=[season / "vase-0"])
    assert code == 1 and "vase-0: RuntimeError: no more film, raised in test_batch.py, line " in err
    assert "which is no part of photonormal." in err and err.count("\n") == 1


def test_a_list_is_not_stale_for_its_neighbours(season, tmp_path, here, batch):
    folder = season / "vase-0"
    lights = np.loadtxt(folder / "light_directions.txt")
    lines = [f"{j + 1:03d}.png {x} {y} {z}" for j, (x, y, z) in enumerate(lights)]
    (folder / "a.lp").write_text("\n".join([str(len(lines)), *lines]))
    assert batch(captures=[folder / "*.lp"])[1].startswith("1 measured")
    shutil.copy(folder / "a.lp", folder / "b.lp")
    shutil.copy(folder / "001.png", folder / "of b.png")
    assert batch(captures=[folder / "*.lp"])[1].startswith("1 measured, 1 were done")
    (folder / "crop.txt").write_text("2,2,20,20")
    assert batch(captures=[folder / "*.lp"])[1].startswith("2 measured")


def write_again(picture):
    """A picture like the one it is a copy of, and not equal to it."""
    import cv2

    samples = cv2.imdecode(np.fromfile(picture, np.uint8), -1)
    cv2.imencode(".png", samples // 2)[1].tofile(picture)


def test_what_is_stale_is_named_and_made_again(season, tmp_path, here, batch, monkeypatch):
    results = tmp_path / "results"
    assert batch()[0] == 0
    before = times(results)
    os.utime(season / "vase-0" / "001.png")  # another time, the same content
    write_again(season / "vase-1" / "002.png")
    (season / "vase-2" / "notes.txt").write_text("beside the photographs")
    code, out, err = batch()
    assert code == 0 and "2 measured, 1 were done" in out
    assert "vase-1 is measured again: 002.png has changed" in err
    assert "vase-2 is measured again: notes.txt has come" in err
    after = times(results)
    assert [before[name] == after[name] for name in sorted(before)] == [True, False, False]
    (results / "vase-0" / "normals.npz").unlink()
    assert "vase-0 is measured again: files of it are gone" in batch()[2]
    monkeypatch.setattr(pn, "__version__", "9.9")
    monkeypatch.setattr(state.Job, "made", lambda job: {**made(job), "photonormal": "9.9"})
    assert "vase-1 is measured again: version 0.1.0, not 9.9" in batch()[2]


made = state.Job.made


def test_where_nothing_is_to_be_done_no_process_begins(season, batch, here, monkeypatch):
    started = []
    monkeypatch.setattr(workers, "begin_loading", lambda: started.append(True))
    assert batch()[0] == 0 and started == [True]
    monkeypatch.undo()
    monkeypatch.setattr(workers, "begin_loading", lambda: started.append(True))
    assert "0 measured, 3 were done" in batch()[1] and started == [True]


def test_results_of_other_options_are_refused(season, tmp_path, here, batch):
    results = tmp_path / "results"
    batch()
    before = times(results)
    code, out, err = batch("--normals-frame", "directx")
    assert code == 2 and out == "" and err.count("\n") == 1
    assert (
        "(normals-frame opengl, not directx), and 2 more" in err and "--overwrite" in err and times(results) == before
    )
    assert "3 measured" in batch("--normals-frame", "directx", "--overwrite")[1]
    assert "0 measured, 3 were done" in batch("--normals-frame", "directx", "--memory", "3GB", "--device", "cpu")[1]


def test_measure_and_batch_make_the_same(season, tmp_path, here, batch, capsys):
    from photonormal.cli import main
    from tests.batch.conftest import WORDS

    batch()
    results = tmp_path / "results"
    shutil.rmtree(results / "vase-1")
    assert main(["measure", str(season / "vase-1"), "--out", str(results / "vase-1"), *WORDS]) == 0
    capsys.readouterr()
    assert "0 measured, 3 were done" in batch()[1]


def test_each_result_has_a_page_that_its_row_opens(season, tmp_path, here, batch):
    batch()
    results = tmp_path / "results"
    assert rows(results)["vase-1"]["page"] == "vase-1/view.html"
    assert 'href="vase-1/view.html"' in (results / "index.html").read_text()
    page = (results / "vase-1" / "view.html").read_text()
    assert '"tile/0/normals/0/0/0":' in page and "`photonormal view` shows all" in page


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names of files are text")
def test_names_that_are_no_text_are_measured_and_told(season, tmp_path, here, batch):
    (season / "vase-0").rename(season / os.fsdecode(b"caf\xe9"))
    (season / "vase-1").rename(season / "report.json")  # which a file of the batch is called
    code, _, err = batch()
    assert code == 1 and err.count("\n") == 1 and "results/report.json is a file but a folder" in err
    assert sorted(rows(tmp_path / "results")) == [r"caf\udce9", "report.json", "vase-2"]
    assert (tmp_path / "results" / os.fsdecode(b"caf\xe9") / "view.html").is_file()


def test_names_that_are_too_long_are_told(season, tmp_path, here, batch):
    (season / "list.csv").write_text(f"capture,name\n{'n' * 300},gone\nvase-1,\n")
    code, out, err = batch(captures=[season / "list.csv"])
    assert code == 1 and out.startswith("1 measured") and err.count("\n") == 1 and "File name too long" in err
    code, out, err = batch("--out", tmp_path / ("o" * 300))
    assert (code, out, err.count("\n")) == (2, "", 1) and "its name is too long" in err


def test_a_result_stays_when_its_photographs_break(season, tmp_path, here, batch):
    results = tmp_path / "results"
    batch()
    cut(season / "vase-0" / "001.png")
    code, _, err = batch()
    assert code == 1 and "vase-0 is measured again: 001.png has changed" in err
    assert (results / "vase-0" / "normals.npz").is_file()
    assert rows(results)["vase-0"]["state"] == "failed"


def test_other_things_in_the_folder_are_left_alone(season, tmp_path, here, batch):
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "summary.csv").write_text("mine")
    code, _, err = batch()
    assert code == 2 and "summary.csv was not written by photonormal" in err
    (tmp_path / "results" / "summary.csv").rename(tmp_path / "results" / "letter.txt")
    code, _, err = batch()
    assert code == 2 and "holds no photonormal result" in err
    assert [p.name for p in (tmp_path / "results").iterdir()] == ["letter.txt"]
    assert batch("--overwrite")[0] == 0 and (tmp_path / "results" / "letter.txt").is_file()


def test_events_are_lines_of_json(season, tmp_path, here, batch):
    cut(season / "vase-1" / "003.png")
    assert batch()[0] == 1 and batch("--json-lines")[1].count('"begun"') == 0
    shutil.rmtree(tmp_path / "results" / "vase-0")
    shutil.rmtree(tmp_path / "results" / "vase-2")
    _, out, err = batch("--json-lines", "--retry", "failed")
    events = [json.loads(line) for line in out.splitlines()]
    assert err == "" and events[0] == {"event": "found", "captures": 3, "waiting": 3, "left_out": []}
    assert [e["event"] for e in events[1:-1]] == ["begun", "done", "begun", "failed", "begun", "done"]
    assert events[4]["capture"] == "vase-1" and events[4]["kind"] == "input" and "truncated" in events[4]["message"]
    assert events[-1]["measured"] == 2 and events[-1]["failed"] == 1


def test_a_file_among_the_captures_is_told_and_left_out(season, tmp_path, here, batch):
    (season / "notes.txt").write_text("dug up in spring")
    code, out, err = batch()
    assert code == 0 and out.startswith("3 measured, 0 were done") and err.count("\n") == 1
    assert f"left out, since only folders and .lp files are captures: {season / 'notes.txt'}" in err
    assert json.loads(batch("--json-lines")[1].splitlines()[0])["left_out"] == [str(season / "notes.txt")]


def test_what_another_batch_has_made_since_is_not_made_again(season, tmp_path, batch, monkeypatch):
    def run(waiting, at, begun, jobs):
        for named in waiting:
            yield [work(named), work(named)][1]

    monkeypatch.setattr(workers, "work_through", run)
    monkeypatch.setattr(workers, "begin_loading", lambda: None)
    written = []
    monkeypatch.setattr("photonormal.job.write_result", lambda *a, **k: written.append(1) or write_result(*a, **k))
    assert batch()[0] == 0 and len(written) == 3


def test_what_another_is_just_at_is_waited_for_and_not_failed(season, tmp_path, here, batch, monkeypatch):
    results, looks = tmp_path / "results", iter(range(3))
    batch()
    shutil.rmtree(results / "vase-0")
    other = FileBatch(results / "vase-0")
    other.open(0)

    def in_use(folder):
        if next(looks) == 2:
            other.close()
        return disk.in_use(folder)

    monkeypatch.setattr(run, "LOOK_S", 0)
    monkeypatch.setattr(run, "in_use", in_use)
    code, out, err = batch()
    assert code == 0 and "1 measured, 2 were done" in out and next(looks, None) is None
    assert err == "photonormal: waiting for another photonormal, which measures vase-0.\n"
    assert rows(results)["vase-0"]["state"] == "done"


def test_the_summary_tells_what_another_batch_has_measured_since(season, tmp_path, here, batch, monkeypatch):
    def run(waiting, at, begun, jobs):
        for named in waiting:
            yield work(named)
        work(replace(waiting[0], job=replace(waiting[0].job, out=tmp_path / "results" / "of another")))

    monkeypatch.setattr(workers, "work_through", run)
    assert batch()[0] == 0 and rows(tmp_path / "results")["of another"]["state"] == "done"


def test_what_failed_in_another_run_is_told_as_such(season, tmp_path, here, batch):
    assert batch(captures=[season])[0] == 1  # which holds captures, and is none
    assert batch()[0] == 0
    told = rows(tmp_path / "results")["season"]["failure"]
    assert told.endswith(f"It was named in another run: remove {tmp_path / 'results' / 'season'} if it is no capture.")


def test_the_parquet_table_is_the_csv_table(season, tmp_path, here, batch):
    parquet = pytest.importorskip("pyarrow.parquet")
    cut(season / "vase-1" / "003.png")
    batch()
    found = parquet.read_table(tmp_path / "results" / "summary.parquet").to_pylist()
    told = rows(tmp_path / "results")
    assert [{k: "" if v is None else str(v) for k, v in row.items()} for row in found] == list(told.values())


def test_a_method_that_there_is_not_is_refused_before_anything(season, tmp_path, here, batch):
    (season / "list.csv").write_text("capture,method\nvase-0,\nvase-1,woodhm\n")
    code, out, err = batch(captures=[season / "list.csv"])
    assert (code, out, err.count("\n")) == (2, "", 1) and "no method 'woodhm'" in err
    assert not (tmp_path / "results").exists()


def test_a_batch_goes_on_when_nobody_reads_its_events_any_more(season, tmp_path, here, batch, monkeypatch):
    gone = iter([None])

    def write(text):
        if text.startswith('{"event": "begun"'):
            next(gone)  # once; what is written later goes nowhere
            raise BrokenPipeError

    monkeypatch.setattr("sys.stdout.write", write)
    monkeypatch.setattr(batching, "say_no_more", lambda: monkeypatch.setattr("sys.stdout.write", len))
    code, _, err = batch("--json-lines")
    assert code == 0 and err.count("\n") == 1 and "nobody reads the events any more" in err
    assert len(times(tmp_path / "results")) == 3
