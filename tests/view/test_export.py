"""The page as one file: it opens without a server, and loads nothing."""

import re

import numpy as np
import pytest

from photonormal.view import export_page, show
from tests.browser import CHROMIUM, DRIVER, MISSING, Browser
from tests.view.conftest import relief, write_result


def test_the_file_loads_nothing(result, tmp_path):
    path, reduced = export_page(result, tmp_path / "page.html")
    text = re.sub(r'<script type="application/json".*?</script>', "", path.read_text(), flags=re.DOTALL)
    assert reduced == 1 and "connect-src" not in text
    assert not re.search(r"""<(img|link|script|iframe)[^>]*(src|href)\s*=\s*["']?(?!data:,)|url\(|@import""", text)


def test_the_photographs_inside_have_lights_all_around():
    around = np.radians(np.arange(36) * 137.5)  # the order of a dome, in which every third lies on one side
    lights = np.stack([np.cos(around), np.sin(around), np.ones(36)], axis=-1) / 2**0.5
    photographs = [{"index": j, "name": f"{j}.png", "light": [float(v) for v in L]} for j, L in enumerate(lights)]
    picked = show.some_photographs(photographs, 12)
    angles = np.sort([np.degrees(np.arctan2(p["light"][1], p["light"][0])) % 360 for p in picked])
    assert len(picked) == 12 and np.diff([*angles, angles[0] + 360]).max() < 60
    assert [p["index"] for p in picked] == sorted(p["index"] for p in picked)
    unlit = [{**p, "light": None} for p in photographs]
    assert len(show.some_photographs(unlit, 12)) == 12 and show.some_photographs(photographs[:5], 12) == photographs[:5]


@pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason=MISSING)
def test_it_works_from_the_disk(result, tmp_path):
    path, _ = export_page(result, tmp_path / "page.html")
    with Browser(tmp_path / "profile") as b:
        b.open(path.as_uri())
        assert b.errors() == [] and b.run("return performance.getEntriesByType('resource').length") == 0
        layers = b.run("return [...document.getElementById('first').options].map((o) => o.value)")
        assert layers == ["relit", "photograph", "normals", "albedo", "height", "expected", "error"]
        for layer in layers:
            b.choose("#first", layer)
            b.settle()
            x, y, w, h = b.box("#stage")
            part = b.picture()[
                int(y + h / 2) - 40 : int(y + h / 2) + 40, int(x + w / 2) + 30 : int(x + w / 2) + 90
            ].astype(int)
            ground = b.picture()[int(y) + 60, int(x) + 20].astype(int)
            assert abs(part - ground).max(-1).mean() > 25, layer
        b.click('[data-value="surface"]')
        b.settle()
        assert b.errors() == []


def test_a_large_result_is_reduced_and_that_is_said(run, tmp_path, monkeypatch):
    monkeypatch.setattr(show, "FILE_PIXELS", 200_000)
    folder = write_result(tmp_path / "relief", *relief(600, 800))
    code, out, err = run("export", folder, "--page", tmp_path / "page.html")
    assert (code, err) == (0, "") and "1/2 of its size" in out
    text = (tmp_path / "page.html").read_text()
    assert "1/2 of its size" in text and "tile/0/normals/1/0/0" in text and "tile/0/normals/0/0/0" not in text


def test_no_file_is_replaced_unasked(result, run, tmp_path):
    (tmp_path / "there.html").write_text("mine")
    for page, says in (
        (tmp_path / "there.html", "--overwrite"),
        (tmp_path / "page.pdf", "an .html file"),
        (tmp_path / "no" / "p.html", "does not exist"),
    ):
        code, _, err = run("export", result, "--page", page)
        assert code == 2 and says in err and len(err.splitlines()) == 1
    assert (tmp_path / "there.html").read_text() == "mine"
    assert run("export", result, "--page", tmp_path / "there.html", "--overwrite")[0] == 0
