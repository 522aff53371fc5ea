"""Tables: what is best, over how many objects, and published figures apart from measured ones."""

import errno
import json
import re
import shutil

import pytest

from photonormal.bench.tables import AVERAGE, MEANS, Cell, Column, Cost, ErrorTable, MethodRow, tables
from photonormal.export import load_normals
from photonormal.scoring import score


def row(label: str, **errors: float) -> MethodRow:
    return MethodRow(
        label, label, {k: Cell(v) for k, v in errors.items()}, len(errors) - 1, Cost(None, 1.0, None, None, "cpu")
    )


def test_figures_are_the_errors_of_what_is_stored(runs):
    first = tables(runs)[0]
    assert first.title == "diligent, all images"  # bear has more of them
    trimmed = next(r for r in first.rows if r.label == "trimmed")
    truth = load_normals(runs / "truth" / "diligent" / "cat.npz")
    expected = score(load_normals(runs / "trimmed" / "diligent" / "cat.npz"), truth).mean_deg
    assert trimmed.cells["cat"].value == pytest.approx(expected, abs=1e-4)
    three = [trimmed.cells[o].value for o in ("ball", "bear", "cat")]
    assert trimmed.cells["average"].value == pytest.approx(sum(three) / 3)
    assert trimmed.over == 3 and "bear4" in trimmed.cells


def test_absent_objects_are_blank_columns(runs, run):
    code, out, _ = run("table", runs)
    head, _, *rows = [line for line in out.splitlines() if line.startswith("|")][:4]
    assert code == 0 and "| buddha |" in head and "average of 3" in head
    place = head.split("|").index(" buddha ")
    assert all(r.split("|")[place].strip() == "" for r in rows)


def test_draws_have_a_mean_and_a_spread(runs):
    draws = next(t for t in tables(runs) if t.protocol == "draws")
    assert (draws.images, draws.draws) == (6, 3)
    cell = draws.rows[0].cells["ball"]
    scores = json.loads((runs / draws.rows[0].label / "diligent" / "scores.json").read_text())
    values = [scores[f"ball@6-00{d}.npz"]["score"]["mean_deg"] for d in range(3)]
    mean = sum(values) / 3
    assert cell.value == pytest.approx(mean)
    assert cell.spread == pytest.approx((sum((v - mean) ** 2 for v in values) / 2) ** 0.5)


def test_a_row_of_fewer_draws_says_so(runs, tmp_path, run):
    shutil.copytree(runs, tmp_path / "runs")
    for path in (tmp_path / "runs" / "trimmed" / "diligent").glob("*@6-002.*"):
        path.unlink()
    draws = next(t for t in tables(tmp_path / "runs") if t.protocol == "draws")
    assert draws.draws == 3 and {r.label: r.draws for r in draws.rows} == {"trimmed": 2, "woodham": 3}
    printed = run("table", tmp_path / "runs")[1].split("3 random draws")[1]
    lines = [line for line in printed.splitlines() if line.startswith("| ")]
    assert "(2 draws) |" in next(x for x in lines if x.startswith("| trimmed"))
    assert "draws)" not in next(x for x in lines if x.startswith("| woodham"))


X = Column("x", "object")


def test_a_mean_over_many_objects_weighs_each_of_them_alike(runs, tmp_path, monkeypatch):
    """Also where one of them has fewer draws."""
    shutil.copytree(runs, tmp_path / "runs")
    folder = tmp_path / "runs" / "trimmed" / "diligent"
    for path in folder.glob("ball@6-00[12].*"):
        path.unlink()
    monkeypatch.setattr("photonormal.bench.tables.WIDE", 1)
    draws = next(t for t in tables(tmp_path / "runs", ["trimmed"]) if t.protocol == "draws")
    scores = json.loads((folder / "scores.json").read_text())
    found = {}
    for name, kept in scores.items():
        if "@6-0" in name:
            found.setdefault(name.split("@")[0], []).append(kept["score"]["mean_deg"])
    assert sorted(map(len, found.values())) == [1, 3, 3]
    expected = sum(sum(values) / len(values) for values in found.values()) / 3
    assert draws.rows[0].cells["mean_deg"].value == pytest.approx(expected)


def test_the_best_is_bold_and_the_second_underlined_with_ties():
    rows = (row("a", x=1.001, average=1), row("b", x=0.999, average=1), row("c", x=2.0, average=9), row("d", x=3.0))
    table = ErrorTable("d", "all", 96, ("0",), (X, AVERAGE), rows)
    assert table.rank(X) == {"a": 1, "b": 1, "c": 2}


def test_an_average_over_fewer_objects_is_never_the_best():
    rows = (row("a", x=5.0, y=6.0, average=5.5), row("b", x=1.0, average=1.0), row("c", x=7.0, y=7.0, average=7.0))
    table = ErrorTable("d", "all", 96, ("0",), (X, Column("y", "object"), AVERAGE), rows)
    assert table.rank(AVERAGE) == {"a": 1, "c": 2}


def test_more_is_better_for_shares():
    rows = (row("a", below_15=90.0), row("b", below_15=95.0))
    assert ErrorTable("d", "all", 96, ("0",), MEANS, rows).rank(MEANS[1]) == {"b": 1, "a": 2}


@pytest.fixture
def ninety_six(runs, tmp_path):
    """The stored runs, made to look like predictions from 96 images."""
    out = tmp_path / "runs"
    shutil.copytree(runs, out)
    pretend(out)
    return out


def pretend(out):
    for path in out.glob("*/diligent/*.json"):
        record = json.loads(path.read_text())
        if record.get("protocol") == "all":
            path.write_text(json.dumps(record | {"images": ["x.png"] * 96}))


def test_published_figures_stand_beside_ours_with_the_difference(ninety_six, run):
    out = run("table", ninety_six, "--json")[1]
    table = next(t for t in json.loads(out) if t["images"] == 96)
    woodham = next(r for r in table["rows"] if r["method"] == "woodham")
    assert woodham["published"][0]["values"]["ball"] == 4.10
    assert woodham["difference"]["ball"] == pytest.approx(woodham["measured"]["ball"] - 4.10, abs=1e-3)
    # of the same three objects: (4.10 + 8.39 + 8.41) / 3
    assert woodham["difference"]["average"] == pytest.approx(woodham["measured"]["average"] - 6.9667, abs=1e-3)
    trimmed = next(r for r in table["rows"] if r["method"] == "trimmed")
    assert trimmed["published"] == [] and trimmed["difference"] == {}
    printed = run("table", ninety_six)[1]
    assert re.search(r"\| woodham \| [^|]*<sub>4\.10, [+-]\d+\.\d\d</sub> \|", printed)


def test_methods_that_only_others_have_come_apart_and_when_asked(ninety_six, run):
    assert "Manifold-PSN" not in run("table", ninety_six)[1]
    printed = run("table", ninety_six, "--published")[1]
    apart = printed.split("Published by others, not measured here")[1]
    assert "| Manifold-PSN | 3.05 | 6.31 |" in apart and "the average takes bear" in apart
    assert "Manifold-PSN" not in printed.split("Published by others")[0]
    assert "| PS-FCN [" not in apart  # it can be measured here
    row = next(line for line in apart.splitlines() if line.startswith("| Manifold-PSN"))
    assert "| average of 3 | average as printed |" in apart
    assert row.endswith("| 5.19 | 8.09 |")  # (3.05 + 6.31 + 6.22) / 3


def test_a_method_with_other_options_is_not_set_beside_published_figures(root, tmp_path):
    from photonormal.bench import bench

    bench("diligent", root, tmp_path, methods="sbl,rough=sbl:steps=3", objects="ball")
    pretend(tmp_path)
    sources = {r.label: r.sources for r in tables(tmp_path)[0].rows}
    assert sources["rough"] == () and sources["sbl"][0].values["ball"] == 2.54


def test_seconds_and_memory_stand_below(runs, run):
    printed = run("table", runs)[1]
    line = next(x for x in printed.split("Seconds for one object")[1].splitlines() if x.startswith("| woodham"))
    read, solve, memory = (float(x) for x in line.split("|")[2:5])
    assert read >= 0 and solve >= 0 and memory > 50


def test_latex_is_balanced(runs, run):
    printed = run("table", runs, "--latex")[1]
    assert printed.count(r"\begin{tabular}") == printed.count(r"\end{tabular}") > 0
    assert printed.count("{") == printed.count("}") and "_" not in re.sub(r"\\_", "", printed)
    for table in printed.split(r"\begin{tabular}")[1:]:
        body = table.split(r"\end{tabular}")[0]
        assert len({line.count("&") - line.count(r"\&") for line in body.splitlines() if line.endswith(r"\\")}) == 1


def test_only_the_methods_asked_for(runs, run):
    printed = run("table", runs, "--methods", "trimmed")[1]
    assert "trimmed" in printed and "woodham" not in printed


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("RUNS", "--methods", "l1"), "holds no method 'l1'; it has trimmed, woodham"),
        (("RUNS", "--datasets", "cycles"), "holds no dataset 'cycles'"),
        (("RUNS", "--json", "--latex"), "one format"),
        (("EMPTY",), "holds no predictions"),
        (("ABSENT",), "is no folder"),
    ],
)
def test_bad_input_is_one_line(runs, tmp_path, run, arguments, says):
    (tmp_path / "empty").mkdir()
    places = {"RUNS": runs, "EMPTY": tmp_path / "empty", "ABSENT": tmp_path / "absent"}
    code, _, err = run("table", *(places.get(a, a) for a in arguments))
    assert code == 2 and says in err and len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("file", "content", "says"),
    [
        ("woodham/diligent/config.json", '{"layout": 7, "photonormal": "9.1"}', "layout 7 of photonormal 9.1"),
        ("woodham/diligent/config.json", "{", "can't be read"),
        ("woodham/diligent/ball.json", "", "can't be read"),
        ("woodham/diligent/ball.npz", "no npz", "ball.npz can't be read"),
        ("truth/diligent/ball.npz", None, "ball.npz is missing"),
    ],
)
def test_damaged_runs_are_one_line(runs, tmp_path, run, file, content, says):
    shutil.copytree(runs, tmp_path / "runs")
    path = tmp_path / "runs" / file
    path.unlink() if content is None else path.write_text(content)
    code, _, err = run("table", tmp_path / "runs")
    assert code == 2 and says in err and len(err.splitlines()) == 1


def test_a_folder_that_can_not_be_written_is_read(runs, tmp_path, monkeypatch):
    """Errors found are kept where they can be, and found again where not."""
    from photonormal.bench import scores
    from photonormal.disk import unwritable

    folder = shutil.copytree(runs, tmp_path / "runs")
    for kept in folder.rglob("scores.json"):
        kept.unlink()

    def refused(path, data):
        raise unwritable(path, OSError(errno.EROFS, "Read-only file system"))

    monkeypatch.setattr(scores, "write", refused)
    assert tables(folder) == tables(runs) and not list(folder.rglob("scores.json"))
