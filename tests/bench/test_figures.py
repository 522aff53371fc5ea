"""Figures: written as PNG and PDF, and showing what is stored."""

import json
import shutil

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from photonormal.bench.figures import FIGURES, Wish
from photonormal.bench.figures.convergence import convergence, read_journal
from photonormal.bench.figures.curves import _area, images, name_points, seconds
from photonormal.bench.figures.maps import dataset_of, errors
from photonormal.bench.figures.materials import materials
from photonormal.bench.figures.relief import relief
from photonormal.bench.figures.style import COLOURS
from photonormal.bench.tables import tables
from photonormal.integration import integrate
from photonormal.types import InputError
from tests.scenes import sphere


@pytest.fixture
def trainings(tmp_path):
    for name, start in (("prior", 15), ("noprior", 20)):
        entries = [{"step": s, "kind": "train", "loss_angle_deg": start - s / 100} for s in (1, 50, 100)]
        entries += [{"step": s, "kind": "clean", "mean_deg": start - s / 50} for s in (50, 100)]
        entries += [{"step": 100, "kind": "clean", "mean_deg": start - 3}]  # resumed: written again
        (tmp_path / name).mkdir()
        (tmp_path / name / "journal.jsonl").write_text("".join(json.dumps(e) + "\n" for e in entries))
    return tmp_path


def test_a_folder_may_have_an_equals_sign_in_its_name(trainings):
    folder = trainings / "lr=0.1"
    shutil.copytree(trainings / "prior", folder)
    drawn = convergence(Wish((str(folder), f"b=1={trainings / 'noprior'}")))
    assert [line.get_label() for line in drawn.axes[0].lines] == ["lr=0.1", "b=1"]


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_a_png_and_a_pdf(pair, trainings, tmp_path, run, name):
    places = [trainings / "prior", f"none={trainings / 'noprior'}"] if name == "convergence" else [pair]
    code, out, err = run("figure", name, *places, "--out", tmp_path / "figures")
    assert (code, err) == (0, "")
    png, pdf = (tmp_path / "figures" / f"{name}.{e}" for e in ("png", "pdf"))
    assert out.split() == [str(png), str(pdf)]
    assert png.read_bytes()[:4] == b"\x89PNG" and pdf.read_bytes()[:4] == b"%PDF"


def test_error_maps_share_their_colours_and_state_the_mean(runs):
    figure = errors(Wish((str(runs),), methods=("woodham", "trimmed"), limit_deg=12))
    maps = [a for a in figure.axes if a.images and a.images[0].get_cmap().name == "cividis"]
    assert len(maps) == 6 and {a.images[0].get_clim() for a in maps} == {(0, 12)}
    woodham = next(r for r in tables(runs)[0].rows if r.label == "woodham")
    assert maps[0].get_xlabel() == f"{woodham.cells['ball'].value:.2f}°"


def test_error_against_images_is_the_tables_average(pair):
    line = images(Wish((str(pair),), methods=("woodham",))).axes[0].lines[0]
    found = {t.images: t.rows[0].cells["average"].value for t in tables(pair, ["woodham"]) if t.protocol != "psfcn"}
    assert dict(zip(line.get_xdata(), line.get_ydata(), strict=True)) == pytest.approx(found)
    assert sorted(found) == [4, 8, 12]


def test_error_against_seconds_has_a_mark_for_each_method(runs):
    axes = seconds(Wish((str(runs),))).axes[0]
    assert {t.get_text() for t in axes.texts} == {"woodham", "trimmed"} and len(axes.lines) == 2


def test_names_of_many_points_do_not_cover_each_other():
    seconds_ = (5.4, 1.6, 0.06, 0.08, 0.5, 0.8, 0.7, 0.9, 0.5, 4.1, 7.3, 0.8, 2.7, 12.4, 13.7)
    errors_ = (5.7, 7.2, 10.2, 6.6, 6.9, 6.5, 6.9, 7.3, 6.2, 9.3, 8.3, 6.1, 6.6, 6.1, 5.4)
    points = list(zip(seconds_, errors_, strict=True))
    figure = Figure(figsize=(4.8, 3.4))
    a = figure.subplots()
    a.plot(*zip(*points, strict=True), "o")
    a.set_xscale("log")
    name_points(figure, a, points, [f"method-{i}" for i in range(15)])
    figure.draw_without_rendering()
    boxes = [Text.get_window_extent(t) for t in a.texts]
    assert len(boxes) == 15
    assert max(_area(Bbox.intersection(p, q)) for i, p in enumerate(boxes) for q in boxes[:i]) < 1  # pixel
    border = a.get_window_extent()
    assert all(border.x0 <= b.x0 and b.x1 <= border.x1 and border.y0 <= b.y0 and b.y1 <= border.y1 for b in boxes)


def test_materials_are_in_the_order_of_least_squares(runs):
    figure = materials(Wish((str(runs),)))
    heights = {a.get_title("left").split(":")[0]: [p.get_height() for p in a.patches] for a in figure.axes}
    assert heights["woodham"] == sorted(heights["woodham"]) and len(heights["trimmed"]) == 3


def test_which_dataset_is_drawn(runs, tmp_path):
    for dataset in ("materials-a", "materials-b", "diligent"):
        shutil.copytree(runs / "woodham" / "diligent", tmp_path / "woodham" / dataset)
    wish = Wish((str(tmp_path),))
    assert dataset_of(wish) == "diligent" and dataset_of(Wish((str(tmp_path),), "materials-b")) == "materials-b"
    with pytest.raises(InputError, match="choose one with --dataset"):
        dataset_of(wish, "materials")
    shutil.rmtree(tmp_path / "woodham" / "materials-a")
    assert dataset_of(wish, "materials") == "materials-b"


def test_convergence_draws_the_journals(trainings):
    assert read_journal(trainings / "prior")["clean"] == [(50, 14.0), (100, 12.0)]
    figure = convergence(Wish((f"with={trainings / 'prior'}", f"without={trainings / 'noprior'}")))
    assert [a.get_title() for a in figure.axes] == ["training crops", "validation, held-out materials"]
    assert [t.get_text() for t in figure.axes[0].get_legend().texts] == ["with", "without"]


def test_a_sphere_s_relief_is_lit_from_the_upper_left():
    truth = sphere(48)
    picture = relief(integrate(truth), truth)
    inside = (picture < 255).all(-1)
    rows = np.flatnonzero(inside.any(1))
    middle = picture.shape[0] / 2, picture.shape[1] / 2
    upper_left = inside & (np.indices(inside.shape)[0] < middle[0]) & (np.indices(inside.shape)[1] < middle[1])
    lower_right = inside & (np.indices(inside.shape)[0] > middle[0]) & (np.indices(inside.shape)[1] > middle[1])
    assert picture[upper_left].mean() > picture[lower_right].mean() + 40
    filled = sum(inside[r, inside[r].argmax() : len(inside[r]) - inside[r][::-1].argmax()].mean() for r in rows)
    assert filled / len(rows) > 0.98  # no gaps


def test_colours_differ_in_lightness_or_hue():
    values = [tuple(int(c[i : i + 2], 16) for i in (1, 3, 5)) for c in COLOURS]
    assert min(max(abs(a - b) for a, b in zip(x, y, strict=True)) for x in values for y in values if x != y) > 50


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("pie", "RUNS"), "no figure 'pie'"),
        (("errors", "ABSENT"), "is no folder"),
        (("errors", "RUNS", "RUNS"), "one folder of runs is needed"),
        (("errors", "RUNS", "--objects", "horse"), "no object 'horse'"),
        (("errors", "RUNS", "--methods", "l1"), "no method 'l1'"),
        (("errors", "RUNS", "--dataset", "cycles"), "no dataset 'cycles'"),
        (("convergence", "RUNS"), "journal.jsonl can't be read"),
        (("convergence", "a=TRAIN/prior", "a=TRAIN/noprior"), "two trainings are called 'a'"),
    ],
)
def test_bad_input_is_one_line(runs, trainings, tmp_path, run, arguments, says):
    places = {"RUNS": runs, "ABSENT": tmp_path / "absent"}
    arguments = [str(places.get(a, a)).replace("TRAIN", str(trainings)) for a in arguments]
    code, _, err = run("figure", *arguments, "--out", tmp_path / "figures")
    assert code == 2 and says in err and len(err.splitlines()) == 1
    assert not (tmp_path / "figures").exists()


def test_without_matplotlib_it_says_what_to_install(runs, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "photonormal.bench.figures.style")
    from photonormal.bench.figures import figure

    with pytest.raises(InputError, match=r"pip install 'photonormal\[bench\]'"):
        figure("images", [runs])
